"""What commands that take a behaviour say of the shipped ones."""

from cmr import manoeuvres


def help_text() -> str:
    """Return the end of a command's --help: behaviours with their settings, manoeuvres with duration and space."""
    return f"""\
behaviours, each with its settings:
  figure_eight (size, speed, laps, start)   drive a figure-eight, or waypoints
  follow (leader, gap, speed)               drive where the leader drove
  commanded                                 do what MOTOR_COMMAND_N says
  manoeuvre (name, speed, repeats, start, space)
                                            drive a manoeuvre, then stop
  module:Class                              your own

manoeuvres, several in turn as name=steps+circles; time and space (how far the
robot's centre may get from its start) for a top speed of 0.74 m/s and a base
width of 0.16 m. Nobody steers meanwhile: a robot that gets further is stopped.
{manoeuvres.help_text()}"""
