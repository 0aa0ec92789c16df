"""tirgeo: a map on a drone's thermal video, placed by sensors alone.

The charter. It holds in every module of this package unless a name says otherwise.

Frames
    ``e``  earth-centred, earth-fixed (WGS84).
    ``n``  north, east, down. In the navigation filter: at the aircraft. Downstream of it (poses,
           maps, overlay): the tangent plane at the origin of the ROS frame ``map``.
    ``b``  body of the aircraft: forward, right, down (FRD), at the IMU.
    ``g``  camera body: forward (optical axis), right, down.
    ``c``  camera optical frame: x right, y down, z forward.
    ROS's frames (``map`` in ENU, ``base_link`` in FLU, ``tir_optical_frame``) exist in messages
    alone; ``tirgeo_ros.io.messages`` converts at the rim.

Axes and names
    ``R_nb`` takes body vectors to ``n``; vectors end in their frame (``v_n``, ``lever_arm_b``).
    Quaternions are Hamilton, ``w, x, y, z``; ``q_nb`` is the rotation of ``R_nb``.
    Euler angles are roll, pitch, yaw (radians), applied yaw, pitch, roll (z-y-x, intrinsic).
    An attitude error ``phi_n`` is the rotation that takes the estimate to the truth, resolved in
    ``n``: ``R_nb_true = exp([phi_n x]) R_nb``.  All error states are truth minus estimate.

Units
    SI and radians. Degrees only where a name ends in ``_deg``.

Heights
    Metres above the WGS84 ellipsoid.

Heading
    0 is true north, clockwise positive.

Time
    Integer nanoseconds, of the measurement (not of its arrival); float seconds for steps.
"""

__version__ = "0.1.0"
