"""Physics that no entry of the catalogue describes: what it is, and how large it typically is.

Each is invented here, and built into tests/reference_plant; none is the mathematics of an effect. All are several times
as large as the noise in at least one signal.
"""

from collections.abc import Mapping

# In the plant's units; they are those of cmr/plant/parameters.py.
UNKNOWN: Mapping[str, Mapping[str, float]] = {
    # Motors whose pull grows with the third power of the duty: weak at low duty, full at full duty.
    "cubic_motor": {"cubic_motor": 0.35},
    # Motors that pull less backward than forward.
    "weak_reverse": {"weak_reverse": 0.12},
    # Torque that rises and falls four times in each turn of the wheel.
    "torque_ripple": {"torque_ripple": 0.3},
    # A controller that lets the motors coast, instead of braking them, while it is given no duty.
    "coasting": {"coasting": 0.6},
    # A caster that turns round whenever the robot reverses, and pushes it aside for half a second.
    "caster_flip": {"caster_flip": 0.35},
    # Wheels that lose traction for 0.4 s at random moments.
    "traction_loss": {"traction_loss": 0.12},
    # Wind, or a magnet: a moving robot drifts sideways, in a direction of the world.
    "side_wind": {"side_wind": 0.03, "side_wind_direction": 0.0},
    # A floor with waves, which turn the robot to one side and the other as it drives along.
    "floor_camber": {"floor_camber": 0.25},
    # Encoders that miss counts above a certain speed.
    "encoder_miscount": {"encoder_miscount": 0.08},
    # A gyro that a magnetic field disturbs: its error depends on twice the heading.
    "gyro_magnetism": {"gyro_magnetism": 0.03},
    # A localisation whose headings are wrong by an angle that depends on the place.
    "pose_heading_warp": {"pose_heading_warp": 0.035},
}

# Friction by other laws than the catalogue's: one that sets in smoothly and holds nothing at rest, and one that is
# larger at low speed and has a viscous part.
FRICTIONS: Mapping[str, Mapping[str, float]] = {
    "dry": {},
    "smooth": {"friction_smoothing": 0.05},
    "stribeck": {"friction_bump": 0.2, "stribeck_shape": 1.0, "viscous_friction": 0.4},
}
