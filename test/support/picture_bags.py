"""Bags of pictures, for the calibrations that look at them."""

from __future__ import annotations

from tirgeo_ros.core.camera.camera_model import XT2
from tirgeo_ros.io.bags.bag import BagWriter, Cdr
from tirgeo_ros.io.messages import Messages


def picture_bag(path, stamps_ns, images, *, info=True, namespace=""):
    """A bag of raw pictures, with the calibration of XT2 beside each unless ``info`` is false."""
    messages = Messages(Cdr().types)
    with BagWriter(path) as writer:
        for stamp_ns, image in zip(stamps_ns, images, strict=True):
            made = messages.image(stamp_ns, image)
            writer.write(f"{namespace}/thermal/image_raw", "sensor_msgs/msg/Image", made, stamp_ns)
            if info:
                made = messages.camera_info(XT2, stamp_ns)
                writer.write("/thermal/camera_info", "sensor_msgs/msg/CameraInfo", made, stamp_ns)
    return path
