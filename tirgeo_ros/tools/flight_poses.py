"""The camera's poses at chosen instants of a recorded flight, through the nodes' core objects."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence

from tirgeo_ros.core.arrival import Arrivals
from tirgeo_ros.core.camera import Camera
from tirgeo_ros.core.confidence import CameraRates
from tirgeo_ros.core.config import EkfConfig, GimbalConfig
from tirgeo_ros.core.errors import BagError, TirgeoError
from tirgeo_ros.core.geodesy import TangentPlane
from tirgeo_ros.core.pose_history import PoseHistory
from tirgeo_ros.core.samples import CameraPose
from tirgeo_ros.io import messages as convert
from tirgeo_ros.io.bag import BagMessage, BagReader, Cdr
from tirgeo_ros.io.messages import TOPIC_TYPES
from tirgeo_ros.tools.inputs import inputs_of, resolved
from tirgeo_ros.tools.progress import Report
from tirgeo_ros.tools.registration import SAMPLES, Registration

_CAMERA_INFO = "thermal/camera_info"
_WHOLE_FLIGHT_S = 1e9
#: Poses so near an instant are kept: more than the longest gap that is interpolated across.
_NEAR_NS = 1_000_000_000
#: The camera's motion is that of so long around an instant.
_MOTION_NS = 50_000_000


class FlightPoses:
    """A bag's camera and its poses around some instants (ns), all in one plane.

    ``refused`` counts the messages that could not be used. Raises BagError where a needed topic
    is absent or no pose could be made.
    """

    def __init__(
        self,
        reader: BagReader,
        ekf: EkfConfig,
        gimbal: GimbalConfig,
        instants_ns: Sequence[int],
        namespace: str = "",
    ) -> None:
        self.camera: Camera | None = None
        self.read = self.refused = 0
        self.registration = Registration(ekf, gimbal)
        self._reader = reader
        self._instants_ns = sorted(instants_ns)
        self._poses: PoseHistory[CameraPose] = PoseHistory(_WHOLE_FLIGHT_S)
        self._arrivals = Arrivals()
        self._cdr = Cdr()
        self._topics = inputs_of(reader, ekf.method, gimbal.composition, namespace, pictures=False)
        self._topics |= _camera_topic(reader, namespace)

    @property
    def plane(self) -> TangentPlane | None:
        """The plane of the poses; None before there was one."""
        return self.registration.navigation.plane

    def read_all(self, progress: Report) -> None:
        """Take the flight through the filter; ``progress`` is told seconds of it."""
        first_ns, last_ns = self._reader.span_ns
        for message in self._reader.messages(self._topics):
            progress((message.log_time_ns - first_ns) * 1e-9, (last_ns - first_ns) * 1e-9)
            try:
                self._take(self._topics[message.topic], message)
            except TirgeoError:
                self.refused += 1

    def at(self, stamp_ns: int) -> tuple[CameraPose, CameraRates | None] | None:
        """The pose at one of the instants and the camera's motion there, or None."""
        pose = self._poses.at(stamp_ns)
        if not isinstance(pose, CameraPose):
            return None
        around = [self._poses.at(stamp_ns + step) for step in (-_MOTION_NS, 0, _MOTION_NS)]
        known = [one for one in around if isinstance(one, CameraPose)]
        return pose, CameraRates.between(known[0], known[-1]) if len(known) > 1 else None

    def _take(self, topic: str, message: BagMessage) -> None:
        decoded = self._cdr.deserialize(message.data, message.typename)
        self.read += 1
        if topic == _CAMERA_INFO:
            self.camera = convert.camera(decoded)
            return
        sample = self._arrivals.stamped(topic, SAMPLES[topic](decoded), message.log_time_ns)
        for pose in self.registration.take(sample).cameras:
            if self._is_near(pose.stamp_ns):
                self._poses.add(pose)

    def _is_near(self, stamp_ns: int) -> bool:
        """Whether one of the instants is."""
        after = bisect_left(self._instants_ns, stamp_ns - _NEAR_NS)
        return any(one <= stamp_ns + _NEAR_NS for one in self._instants_ns[after : after + 1])


def _camera_topic(reader: BagReader, namespace: str) -> dict[str, str]:
    """Resolved name to contract topic of the camera's calibration."""
    name = resolved(_CAMERA_INFO, namespace)
    typename = reader.topics().get(name)
    if typename != TOPIC_TYPES[_CAMERA_INFO]:
        hint = "" if namespace else "; is there a --namespace?"
        raise BagError(f"{reader.path}: needed topic absent: {name}{hint}")
    return {name: _CAMERA_INFO}
