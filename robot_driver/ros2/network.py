"""Discovery range of ROS 2, which it reads from the environment when a node is created."""

import os

SUBNET = "subnet"
LARGEST_DOMAIN = 232  # the ports of larger ones are beyond 65535
RANGES = ("localhost", SUBNET, "off")
WITH_LOCALHOST_ONLY = ("foxy", "galactic", "humble")  # distributions that support only ROS_LOCALHOST_ONLY


def choose_network(domain: int | None, reach: str) -> None:
    """Set the environment for ROS 2's discovery: the domain (None: unchanged) and the range.

    The command line overrides ROS_AUTOMATIC_DISCOVERY_RANGE and ROS_LOCALHOST_ONLY of the environment.
    """
    if domain is not None:
        os.environ["ROS_DOMAIN_ID"] = str(domain)
    if os.environ.get("ROS_DISTRO") in WITH_LOCALHOST_ONLY:
        os.environ["ROS_LOCALHOST_ONLY"] = "0" if reach == SUBNET else "1"
        return
    os.environ.pop("ROS_LOCALHOST_ONLY", None)
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = reach.upper()
