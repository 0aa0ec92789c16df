"""Set the environment of nodes: reachable from this machine only, unless the user widens it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

#: Variables with the path of a Fast DDS profile; later versions use the second name.
PROFILES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")
#: Each of these would let other machines in.
_WIDER = ("ROS_LOCALHOST_ONLY", "ROS_STATIC_PEERS", "ROS_DISCOVERY_SERVER")
_FAST_DDS = ("", "rmw_fastrtps_cpp", "rmw_fastrtps_dynamic_cpp")


def video_environment(given: Mapping[str, str], config: Path) -> dict[str, str]:
    """Return ``given`` with shared memory that holds whole frames, unless a profile is set."""
    if any(name in given for name in PROFILES):
        return dict(given)
    return {**given, PROFILES[0]: str(config / "fastdds.xml")}


def localhost_environment(given: Mapping[str, str], config: Path | None) -> dict[str, str]:
    """Return ``given``, changed so that only this machine reaches the nodes started with it.

    ``config`` is the folder of the profiles, None if they are not installed. A user's own profile
    stays; ROS then limits discovery to this machine, but with sockets on every interface.
    """
    kept = {name: value for name, value in given.items() if name not in _WIDER}
    profile = str(config / "fastdds_localhost.xml") if config else ""
    others = {given[name] for name in PROFILES if name in given} - {profile}
    if not profile or others or given.get("RMW_IMPLEMENTATION", "") not in _FAST_DDS:
        return {**kept, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    return {
        **kept,
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "SYSTEM_DEFAULT",  # the profile is narrower
        PROFILES[0]: profile,
        "SKIP_DEFAULT_XML_FILE": "1",  # else a profile in the working directory takes precedence
    }
