"""Write what ekf_node and gimbal_node publish of poses: the poses, the transforms, the track.

Poses are written in blocks: work of one kind in a row uses the processor's caches better.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.gimbal.pose_buffer import Miss
from tirgeo_ros.core.navigation.estimator.track import Track
from tirgeo_ros.core.streams.stamps import RateLimit
from tirgeo_ros.core.types.poses import BodyPose
from tirgeo_ros.io.messages import Messages
from tirgeo_ros.tools.replay.node_configs import NodeConfigs
from tirgeo_ros.tools.replay.registration import Registered

#: Poses that are written together.
_BLOCK = 32
#: A track is sent whole each time, so it is written this often, and at the end.
_TRACK_RATE_HZ = 0.1

#: Write a message to a contract topic: topic, message, log time (ns).
Write = Callable[[str, object, int], None]


class _Waiting(NamedTuple):
    """Hold poses that are not written yet."""

    found: Registered
    bodies: Sequence[BodyPose | Miss]  # that the camera's poses are made of
    log_time_ns: int


class PoseOutputs:
    """Write the poses of a run, in order, and what follows from them."""

    def __init__(self, configs: NodeConfigs, messages: Messages, write: Write) -> None:
        self._messages, self._write = messages, write
        self._ekf, self._with_camera_tf = configs.ekf, configs.gimbal.publish_tf
        self._fix_rate = RateLimit(configs.ekf.fix_rate_hz)
        self._track = Track(messages.track_point)
        self._track_rate = RateLimit(_TRACK_RATE_HZ)
        self._waiting: list[_Waiting] = []
        self._has_fixed = False
        self._newest_ns = 0

    def new_plane(self, plane: TangentPlane, stamp_ns: int, log_time_ns: int) -> None:
        """Write the origin, and with the first one what is fixed to the aircraft."""
        self.flush()
        self._write("tirgeo/origin", self._messages.origin(plane, stamp_ns), log_time_ns)
        if self._ekf.publish_tf and not self._has_fixed:
            fixed = self._messages.fixed_transforms(self._ekf.aircraft, stamp_ns)
            self._write("/tf_static", self._messages.tf(fixed), log_time_ns)
            self._has_fixed = True
        self._track.clear()

    def add(
        self, found: Registered, body_at: Callable[[int], BodyPose | Miss], log_time_ns: int
    ) -> None:
        """Add poses; ``body_at`` gives the pose that a camera's pose is made of."""
        stamps_ns = [pose.stamp_ns for pose in found.cameras] if self._with_camera_tf else []
        self._waiting.append(_Waiting(found, [*map(body_at, stamps_ns)], log_time_ns))
        if len(self._waiting) >= _BLOCK:
            self.flush()

    def flush(self) -> None:
        """Write the poses that wait; the block is converted as a whole, then written."""
        waiting, self._waiting = self._waiting, []
        made = [(*made, one.log_time_ns) for one in waiting for made in self._messages_of(one)]
        for topic, message, log_time_ns in made:
            self._write(topic, message, log_time_ns)

    def finish(self, log_time_ns: int) -> None:
        """Write what waits, and the whole track."""
        self.flush()
        points = self._track.points()
        if points:
            path = self._messages.path(self._newest_ns, points)
            self._write("tirgeo/path", path, log_time_ns)

    def _messages_of(self, one: _Waiting) -> Iterator[tuple[str, object]]:
        solution, body, messages = one.found.solution, one.found.body, self._messages
        if solution is not None and body is not None:
            yield "tirgeo/odometry", messages.odometry(solution, body)
            if self._ekf.publish_tf:
                yield "/tf", messages.tf([messages.body_transform(body)])
            if self._fix_rate.due(solution.stamp_ns):
                yield "tirgeo/fix", messages.fix(solution)
            self._track.add(body)
            self._newest_ns = body.stamp_ns
            if self._track_rate.due(body.stamp_ns):
                yield "tirgeo/path", messages.path(body.stamp_ns, self._track.points())
        for pose in one.found.cameras:
            yield "tirgeo/camera_pose", messages.camera_pose(pose)
        for pose, made_of in zip(one.found.cameras, one.bodies, strict=False):
            if not isinstance(made_of, Miss):
                yield "/tf", messages.tf([messages.camera_transform(made_of, pose)])
