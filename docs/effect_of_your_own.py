"""An effect that CMR does not come with: a brush that sweeps the floor and pushes the robot to one side."""

from cmr.model.effect import Effect
from cmr.model.parameters import ParameterDefinition

SIDE_BRUSH = Effect(
    name="side_brush",
    group="wheels and ground",
    cause="The brush pushes the robot to the {side_brush_push:left/right} with {side_brush_push:.3f} m/s "
    "and slows the wheels by {side_brush_friction:.1f} rad/s^2.",
    equations={
        "body": "sideways = sideways + side_brush_push",
        "acceleration": """
            friction = friction + side_brush_friction
            break_away = break_away + side_brush_friction
        """,
    },
    parameters=(
        ParameterDefinition("side_brush_push", "m/s", "speed to the left", -1.0, 1.0, neutral=0.0, typical=0.02),
        ParameterDefinition("side_brush_friction", "rad/s^2", "friction", 0.0, 1e3, neutral=0.0, typical=2.0),
    ),
    needs="straight runs both ways",
    shows_in="sideways motion that does not depend on the speed",
    confused_with={"lateral_skid": "straight runs", "coulomb_friction": "switch the brush off"},
)
