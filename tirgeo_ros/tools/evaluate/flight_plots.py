"""Plot the flight for an evaluation: attitudes, sigmas, innovations."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tirgeo_ros.core.frames.heading import wrap_pi
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.tools.evaluate.plot import WIDTH_IN, Plot, thinned
from tirgeo_ros.tools.evaluate.result import AttitudeSeries, Evaluation, Innovations, MethodResult
from tirgeo_ros.tools.presentation.plots import COLOURS, figure, logarithmic, svg

_AXES = ("roll", "pitch", "heading")


def flight_plots(found: Evaluation) -> Iterator[Plot]:
    """Yield the plots of the last method, the best, as far as it has data."""
    best = found.methods[-1] if found.methods else None
    if best is None or not len(best.body):
        return
    yield from _attitudes(found, best)
    yield _sigmas(best)
    if best.innovations:
        yield _innovations(best)


def _attitudes(found: Evaluation, best: MethodResult) -> Iterator[Plot]:
    """Yield Figures 18 to 20."""
    start_ns = int(best.body.stamp_ns[0])
    autopilot = found.sensors.autopilot
    made, axes = figure(WIDTH_IN, 5.6, 3, 1, sharex=True)
    for k, panel in enumerate(axes):
        if len(autopilot):
            panel.plot(*_degrees(autopilot, k, start_ns), color=COLOURS[1], label="autopilot")
        panel.plot(*_degrees(best.body, k, start_ns), color=COLOURS[0], label=best.method)
        panel.set_ylabel(f"{_AXES[k]}, deg")
    axes[0].legend(ncols=2)
    axes[2].set_xlabel("time, s")
    yield Plot(
        "Attitude before and after",
        "The aircraft's attitude as the autopilot has it and as the filter has it (Figure 18).",
        [svg(made)],
    )
    if len(autopilot) > 1:
        yield _corrections(autopilot, best.body, start_ns)
    if len(found.sensors.gimbal) > 1 and len(best.camera):
        yield _camera_heading(found.sensors.gimbal, best, start_ns)


def _corrections(autopilot: AttitudeSeries, body: AttitudeSeries, start_ns: int) -> Plot:
    keep = (body.stamp_ns >= autopilot.stamp_ns[0]) & (body.stamp_ns <= autopilot.stamp_ns[-1])
    stamps = body.stamp_ns[keep]
    before = [np.interp(stamps, autopilot.stamp_ns, np.unwrap(angle)) for angle in autopilot.rpy.T]
    corrections = np.degrees(wrap_pi(body.rpy[keep] - np.stack(before, axis=-1)))
    which = thinned(stamps)
    made, axes = figure(WIDTH_IN, 3.0)
    for k, name in enumerate(_AXES):
        t_s = (stamps[which] - start_ns) * 1e-9
        axes.plot(t_s, corrections[which, k], color=COLOURS[2 - k], label=name)
    axes.set(xlabel="time, s", ylabel="correction, deg")
    axes.legend(ncols=3)
    return Plot(
        "Corrections of the attitude",
        "The filter's attitude of the aircraft less the autopilot's (Figure 19, of the heading).",
        [svg(made)],
    )


def _camera_heading(reported: AttitudeSeries, best: MethodResult, start_ns: int) -> Plot:
    made, axes = figure(WIDTH_IN, 3.0)
    axes.plot(*_degrees(reported, 2, start_ns), color=COLOURS[1], label="as reported")
    axes.plot(*_degrees(best.camera, 2, start_ns), color=COLOURS[0], label=best.method)
    axes.set(xlabel="time, s", ylabel="camera heading, deg")
    axes.legend(ncols=2)
    return Plot(
        "Heading of the camera before and after",
        "As the flight controller reports it and as it is used (Figure 20).",
        [svg(made)],
    )


def _sigmas(best: MethodResult) -> Plot:
    camera = best.camera if len(best.camera) else best.body
    keep = thinned(camera.stamp_ns)
    t_s = (camera.stamp_ns[keep] - best.body.stamp_ns[0]) * 1e-9
    made, axes = figure(WIDTH_IN, 4.2, 2, 1, sharex=True)
    for k, name in enumerate(("north", "east", "down")):
        axes[0].plot(t_s, camera.sigma_position_n[keep, k], color=COLOURS[k], label=name)
        angle = np.degrees(camera.sigma_attitude_n[keep, k])
        axes[1].plot(t_s, angle, color=COLOURS[k], label=name)
    axes[0].set(ylabel="position, m")
    axes[1].set(ylabel="rotation about, deg", xlabel="time, s")
    for panel in axes:
        logarithmic(panel, "y")
    axes[0].legend(ncols=3)
    return Plot(
        "What the filter believes of the camera's pose",
        f"One standard deviation under {best.method}; the rotation about down is the heading's.",
        [svg(made)],
    )


def _innovations(best: MethodResult) -> Plot:
    start_ns = int(best.body.stamp_ns[0])
    return Plot(
        "Innovations and test ratios",
        f"Under {best.method}: what each measurement said beyond the prediction (north, east, "
        "down in blue, orange, green), and its square over the gate; above 1 it is refused.",
        [_source(source, start_ns) for source in best.innovations],
    )


def _source(source: Innovations, start_ns: int) -> bytes:
    """Return an SVG: the innovations of one source above their test ratios."""
    made, (above, below) = figure(WIDTH_IN, 3.4, 2, 1, sharex=True)
    keep = thinned(source.stamp_ns)
    t_s = (source.stamp_ns[keep] - start_ns) * 1e-9
    is_heading = source.innovation.shape[1] == 1
    shown = np.degrees(source.innovation) if is_heading else source.innovation
    for k, row in enumerate(shown[keep].T):
        above.plot(t_s, row, ".", markersize=2.5, color=COLOURS[k])
    unit = "deg" if is_heading else "m/s" if "velocity" in source.source else "m"
    above.set(title=source.source.replace("_", " "), ylabel=f"innovation, {unit}")
    used = source.used[keep]
    ratio = np.maximum(source.test_ratio[keep], 1e-6)
    below.plot(t_s[used], ratio[used], ".", markersize=2.5, color=COLOURS[0], label="used")
    if not used.all():
        below.plot(t_s[~used], ratio[~used], "x", color=COLOURS[1], label="refused")
        below.legend(ncols=2)
    below.axhline(1.0, color="#888888", linestyle=":")
    below.set(xlabel="time, s", ylabel="test ratio")
    logarithmic(below, "y")
    return svg(made)


def _degrees(attitudes: AttitudeSeries, axis: int, start_ns: int) -> tuple[Array, Array]:
    """Return times (s) and an angle (deg), a heading in 0 to 360 with nan where it wraps."""
    keep = thinned(attitudes.stamp_ns)
    t_s = (attitudes.stamp_ns[keep] - start_ns) * 1e-9
    angle = np.degrees(attitudes.rpy[keep, axis])
    if axis == 2:
        angle %= 360.0
        angle = np.where(np.abs(np.diff(angle, prepend=angle[:1])) > 180.0, np.nan, angle)
    return np.asarray(t_s, float), np.asarray(angle, float)
