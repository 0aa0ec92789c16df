"""Define the names of the frames in messages, the same for every node."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from tirgeo_ros.core.config.schema import param
from tirgeo_ros.core.types.errors import ConfigError


class FrameIds(NamedTuple):
    """Hold the frame ids of messages, with their prefix; docs/outputs.md draws them."""

    map: str
    base_link: str
    camera: str
    imu_link: str
    rtk_antenna: str
    second_antenna: str
    gps_antenna: str
    gimbal_pivot: str


_FIXED = FrameIds._fields[3:]


def _prefix_fault(text: str) -> str:
    if text.startswith("/"):
        return f"begins with a slash, which tf2 refuses: write {text.lstrip('/')!r}"
    return "has a space" if any(letter.isspace() for letter in text) else ""


def _name_fault(text: str) -> str:
    return _prefix_fault(text) if text else "is empty: a frame needs a name"


@dataclass(frozen=True, slots=True)
class FramesConfig:
    """Names of the frames in messages, given once for all nodes."""

    map_frame: str = param(
        "map",
        "frame of all poses: the tangent plane at tirgeo/origin, east, north, up",
        fault=_name_fault,
    )
    base_link_frame: str = param(
        "base_link", "frame of the aircraft: forward, left, up, at the IMU", fault=_name_fault
    )
    camera_frame: str = param(
        "tir_optical_frame",
        "optical frame of the thermal camera: x right, y down, z forward",
        fault=_name_fault,
    )
    frame_prefix: str = param(
        "",
        "text put before every frame's name, to keep aircraft apart on the one /tf: uav1/",
        fault=_prefix_fault,
    )

    @property
    def frame_ids(self) -> FrameIds:
        """Return the ids with their prefix. Raises ConfigError if two frames have one name."""
        names = FrameIds(self.map_frame, self.base_link_frame, self.camera_frame, *_FIXED)
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ConfigError(
                f"parameters map_frame, base_link_frame, camera_frame: two frames are named "
                f"{', '.join(twice)}: give each its own name ({', '.join(_FIXED)} are taken)"
            )
        return FrameIds(*(self.frame_prefix + name for name in names))


@dataclass(frozen=True, slots=True)
class TransformsConfig(FramesConfig):
    """Names of the frames, and whether a node publishes the transforms between them."""

    publish_tf: bool = param(
        True,
        "publish the transforms between the frames on /tf and /tf_static, where tf2_msgs is "
        "installed; false = another node does",
    )
