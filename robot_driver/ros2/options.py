"""Options of cmr-ros2 for a robot: `ros2:` in a scenario."""

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

from cmr.documents.declared import Between, Word
from cmr.files import read_text, write_atomically
from robot_driver.ros2.network import LARGEST_DOMAIN, RANGES
from robot_driver.ros2.profile import Profile, ProfileError, shipped

NAMESPACE = "/[A-Za-z][A-Za-z0-9_/]*"


@dataclass(frozen=True)
class Bridging:
    """The options of cmr-ros2 for one real robot: its `profile`, the `namespace` of its topics, and its network.

    Raises ValueError for an invalid namespace.
    """

    profile: str
    namespace: str = ""
    domain_id: Annotated[int, Between(0, LARGEST_DOMAIN)] | None = None
    range: Annotated[str, Word(lambda: RANGES)] = RANGES[0]
    no_base_timeout: bool = False

    def __post_init__(self) -> None:
        if self.namespace and not re.fullmatch(NAMESPACE, self.namespace):
            raise ValueError(f"namespace {self.namespace!r} is not like /turtle")

    def found_from(self, folder: Path) -> "Bridging":
        """Return it with the path of the profile resolved from `folder`; the name of a shipped profile is kept.

        Raises ProfileError for a profile that cannot be used, or of a base that must not be driven.
        """
        path = str(folder / Path(self.profile).expanduser())
        here = self if self.profile in shipped() else replace(self, profile=path)
        check_base(Profile.load(here.profile), allowed=self.no_base_timeout)
        return here

    def kept_in(self, path: Path) -> "Bridging":
        """Return it with its profile copied to `path`; a shipped one is not copied. Raises OSError."""
        if self.profile in shipped():
            return self
        write_atomically(read_text(Path(self.profile), ProfileError.bounds.size), path)
        return replace(self, profile=str(path))

    def arguments(self, robot_id: int) -> list[str]:
        """Return the options of cmr-ros2 that bridge this robot."""
        place = f"@{self.namespace}" if self.namespace else ""
        arguments = ["--robot", f"{robot_id}={self.profile}{place}", "--range", self.range]
        arguments += [] if self.domain_id is None else ["--domain-id", str(self.domain_id)]
        return [*arguments, "--no-base-timeout"] if self.no_base_timeout else arguments


def check_base(profile: Profile, *, allowed: bool) -> None:
    """Raise ProfileError if only this process would stop the robot, unless that is `allowed`."""
    if profile.base.command_timeout is None and not allowed:
        raise ProfileError(
            f"{profile.name} has no command timeout of its own: it would drive on if cmr-ros2 were killed or cut off "
            f"({profile.base.source}). Add one to the robot, or give --no-base-timeout (no_base_timeout: true in a "
            "scenario), with a hardware stop in reach."
        )
