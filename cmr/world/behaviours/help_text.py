"""Help text on the shipped behaviours, for commands that take a behaviour."""

from cmr.geometry import manoeuvres


def help_text() -> str:
    """Return the end of a command's --help: behaviours with their settings, manoeuvres with duration and space."""
    return f"""\
behaviours, each with its settings (and clearance, in m between bodies):
  figure_eight (size, speed, laps, start)   drive a figure-eight, or waypoints; to
                                            calibrate, size=1.15 and laps=3 take a
                                            minute at speed=0.2/0.5, half of it at
                                            each; the paper has one: speed=0.3
  waypoints (speed, points, laps)           drive waypoints, points=0:0/1.5:0 [m]
  follow (leader, gap, speed)               drive along the leader's path
  shadow (leader)                           copy the leader's motion beside it: any
                                            manoeuvre, spins on the spot too
  formation (leader, shape, spacing, speed, members, heading)
                                            keep a place: line, column, wedge,
                                            circle; leader=-1 for none
  flock (speed, radius, distance, cohesion, alignment, separation, border)
                                            keep together, do not crowd
  right_of_way (speed, points, laps, at_x, at_y, zone, rule)
                                            waypoints through a crossing; yield
                                            to the right or to the first
  commanded                                 do what MOTOR_COMMAND_N says: cmr-teleop
  manoeuvre (name, speed, repeats, start, space)
                                            drive a manoeuvre, then stop
  investigate (floor, margin, longest, seed, goal)
                                            choose movements that show what the
                                            model gets wrong; only for cmr-pilot,
                                            floor=-1:-1/1:-1/1:1/-1:1 or the
                                            geofence
  module:Class, or a name that a package brings: docs/how_to/write_a_behaviour.md

manoeuvres, several in turn as name=steps+circles; time and space (how far the
robot's centre may get from its start) for a top speed of 0.74 m/s and a base
width of 0.16 m. Nobody steers meanwhile: a robot that gets further is stopped.
{manoeuvres.help_text()}"""
