"""Properties of poses, and corrections to make at their source."""

import math
from dataclasses import dataclass

UNITS = {1.0: "m", 100.0: "cm", 1000.0: "mm"}  # number shown for a metre


@dataclass(frozen=True)
class PosesFound:
    """Properties of poses; the defaults are those of correct poses.

    A metre is shown as `metre`, headings may be in degrees, with an offset `heading_offset` (rad), the tracked point is
    `ahead` and `left` (m) of the turning centre, poses are `lateness` (s) older than their stamps, or perhaps
    `unsure_lateness`. `vertical` is the height axis; if not z, nothing else can be determined. `length` and `turn` are
    the ratios of distance and rotation to those by the wheels.
    """

    metre: float = 1.0
    degrees: bool = False
    mirrored: bool = False
    heading_offset: float = 0.0
    ahead: float = 0.0
    left: float = 0.0
    lateness: float = 0.0
    unsure_lateness: float = 0.0
    vertical: str = "z"
    length: float = 1.0
    turn: float = 1.0

    def corrections(self, robot: int) -> list[str]:
        """Return the corrections to make at the source of this robot's poses, a text each."""
        if self.vertical != "z":
            up = _profile("tracker: {up: y}") if self.vertical == "y" else ""
            return [f"{self.vertical} of the poses is the height: have your system publish a frame with z upward{up}"]
        said = []
        if self.metre != 1.0:
            unit = UNITS[self.metre]
            said.append(f"positions are in {unit}: they have to be in m{_profile(f'tracker: {{unit: {unit}}}')}")
        if self.degrees:
            said.append("headings are in degrees: they have to be in radians")
        if self.mirrored:
            said.append("the frame is mirrored (of the left hand): exchange x and y, or negate y and the heading")
        if self.heading_offset:
            text = (
                f"headings are {math.degrees(self.heading_offset):.0f} degrees too far: turn the body's x axis forward"
            )
            setting = _profile(f"robots: {{{robot}: {{theta: {self.heading_offset:.3f}}}}}", is_added=True)
            said.append(text if self.mirrored else text + setting)  # the angle changes once mirroring is corrected
        if self.ahead or self.left:
            where = f"{_millimetres(self.ahead, 'ahead', 'behind')} and {_millimetres(self.left, 'left', 'right')}"
            setting = _profile(f"robots: {{{robot}: {{x: {self.ahead:.3f}, y: {self.left:.3f}}}}}", is_added=True)
            said.append(f"the tracked point lies {where} of the turning centre{setting}")
        if self.lateness:
            lag = f"{self.lateness:.3f}"
            setting = _profile(f"tracker: {{lag: {lag}}}", is_added=True, camera=f"--lag {lag}")
            text = f"poses are {abs(self.lateness):.2f} s {'older' if self.lateness > 0.0 else 'newer'}"
            said.append(f"{text} than their stamps say{setting if self.lateness > 0.0 else ''}")
        return said

    @property
    def unclear(self) -> str:
        """The undecided property, with the reason; "" if there is none."""
        if not self.unsure_lateness:
            return ""
        return (
            f"cannot tell whether poses are late, because the parts of the drive do not agree: "
            f"{self.unsure_lateness:.2f} s on average"
        )


def _profile(setting: str, *, is_added: bool = False, camera: str = "") -> str:
    """Return the setting for cmr-tracker, or for cmr-camera, that corrects it."""
    words = "add to what is there: " if is_added else ""
    return f" (cmr-tracker, in its profile: {words}{setting}{f'; cmr-camera: {camera}' if camera else ''})"


def _millimetres(metres: float, positive: str, negative: str) -> str:
    return f"{1e3 * abs(metres):.0f} mm {positive if metres >= 0.0 else negative}"
