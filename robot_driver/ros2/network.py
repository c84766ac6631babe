"""How far ROS 2 looks for others, which it reads from the environment when a node is made."""

import os

SUBNET = "subnet"
LARGEST_DOMAIN = 232  # the ports of larger ones are beyond 65535
RANGES = ("localhost", SUBNET, "off")
WITH_LOCALHOST_ONLY = ("foxy", "galactic", "humble")  # distributions that know ROS_LOCALHOST_ONLY alone


def choose_network(domain: int | None, reach: str) -> None:
    """Set the environment by which ROS 2 finds others: the domain (None: as it is), and how far it looks.

    Whoever set ROS_AUTOMATIC_DISCOVERY_RANGE or ROS_LOCALHOST_ONLY himself is overruled: the command line says it.
    """
    if domain is not None:
        os.environ["ROS_DOMAIN_ID"] = str(domain)
    if os.environ.get("ROS_DISTRO") in WITH_LOCALHOST_ONLY:
        os.environ["ROS_LOCALHOST_ONLY"] = "0" if reach == SUBNET else "1"
        return
    os.environ.pop("ROS_LOCALHOST_ONLY", None)
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = reach.upper()
