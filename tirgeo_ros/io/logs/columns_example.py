"""Hold the template of a columns file that ``tirgeo import --example`` writes."""

from __future__ import annotations

#: A flight with everything in one table; a test reads it.
EXAMPLE = """\
# What the columns of a table mean, for tirgeo import log.csv --columns THIS.yaml -o flight.mcap
# Keep what the table has and delete the rest. Each value needs its unit:
#   acceleration  m/s2, g, mg, ft/s2          rate      rad/s, deg/s, mrad/s, mdeg/s, deg/h
#   angle         deg, rad, mrad, 1e-7deg     length    m, ft, km, cm, mm
#   speed         m/s, km/h, mph, knots, ft/s, cm/s, mm/s
#   pressure      Pa, hPa, mbar, kPa          time      s, ms, 0.1ms, us, ns
# A column is its title, or its number from 1 in a table without a header.

table:
  header: true           # false: columns are numbers
  separator: comma       # comma, semicolon, tab, space
  decimal: point         # comma: 9,81 is a number
  skip: 0                # lines before the header
  comment: "#"           # lines that begin so are passed over
  ragged: false          # true: rows may be shorter than most

time:                    # any quantity below may have a time of its own instead
  counts: utc            # utc, gpst: since 1970, in UTC or GPS time; gps: since 1980-01-06;
                         # week: since the GPS week, which is in column 'week: TITLE';
                         # start: since the log's start, given by --start-time, or by the dates
                         # (UTC, whole seconds) in column 'date: TITLE';
                         # written_utc, written_gpst, written_local (with --utc-offset): dates as
                         # 2024-06-11 07:44:39.25; with 'date: TITLE' that column has the date, and
                         # column the time of day
  column: time
  unit: s                # not with written dates

imu:
  accel: {columns: [ax, ay, az], unit: m/s2}     # x, y, z: specific force: with gravity
  gyro: {columns: [gx, gy, gz], unit: rad/s}
  axes: flu              # flu, frd, or where x, y and z point, as [right, front, up]
  attitude:              # the autopilot's own, if there is one; or 'wxyz: [qw, qx, qy, qz]'
    {roll: roll, pitch: pitch, yaw: yaw, unit: deg, frame: ned}  # FRD in NED; enu: FLU in ENU

rtk_position:            # and gps_position, whose sigma may be left out
  latitude: lat
  longitude: lon
  unit: deg
  height: {column: height, unit: m, above: ellipsoidal}   # msl: --geoid-undulation; takeoff
  status: {column: fix, fixed: [4], float: [2, 5], single: [1]}   # others are refused;
                         # or {always: single}
  sigma: {north: sn, east: se, up: su, unit: m}  # or horizontal and vertical; or one for all
                         # three: column, or value: a number
  where: {valid: [1, 2]} # only rows with these values; any quantity may have it

rtk_velocity:            # and gps_velocity
  {north: vn, east: ve, up: vu, unit: m/s, sigma: {value: 0.05, unit: m/s}}   # or down

rtk_heading:             # of two antennas; never that of a compass
  column: heading
  unit: deg              # from true north, clockwise
  of: nose               # baseline: first antenna to second, as the aircraft.* parameters say
  sigma: {column: sheading, unit: deg}

pressure: {column: baro, unit: hPa, sigma: {value: 0.1, unit: hPa}}

gimbal_joints:           # encoders: angles from the body, yaw, then roll, then pitch
  {yaw: joint_yaw, roll: joint_roll, pitch: joint_pitch, unit: deg, axes: flu}

gimbal_attitude:         # from the world: the camera's own attitude
  attitude: {roll: cam_roll, pitch: cam_pitch, yaw: cam_yaw, unit: deg, frame: ned}
"""
