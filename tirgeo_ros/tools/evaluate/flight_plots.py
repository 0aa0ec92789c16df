"""Plot the flight for an evaluation: attitudes, sigmas, innovations."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tirgeo_ros.core.frames.heading import wrap_pi
from tirgeo_ros.core.types.arrays import Array, IntArray
from tirgeo_ros.tools.evaluate.ground_plots import WIDTH_IN, Plot, thinned
from tirgeo_ros.tools.evaluate.result import AttitudeSeries, Evaluation, Innovations, MethodResult
from tirgeo_ros.tools.presentation.plots import COLOURS, figure, logarithmic, svg

_AXES = ("roll", "pitch", "heading")


def flight_plots(found: Evaluation) -> Iterator[Plot]:
    """Yield the plots of the last method, the best, as far as it has data."""
    best = found.methods[-1]
    if not len(best.body):
        return
    start_ns = int(best.body.stamp_ns[0])
    autopilot, gimbal = found.sensors.autopilot, found.sensors.gimbal
    series = {"autopilot": autopilot, best.method: best.body}
    yield Plot(
        "Attitude before and after",
        "The aircraft's attitude as the autopilot has it and as the filter has it (Figure 18).",
        [_angles(series, range(3), "", start_ns)],
    )
    if len(autopilot) > 1:
        yield Plot(
            "Corrections of the attitude",
            "The filter's attitude of the aircraft less the autopilot's (Figure 19, of the "
            "heading).",
            [_corrections(autopilot, best.body, start_ns)],
        )
    if len(gimbal) > 1 and len(best.camera):
        series = {"as reported": gimbal, best.method: best.camera}
        yield Plot(
            "Heading of the camera before and after",
            "As the flight controller reports it and as it is used (Figure 20).",
            [_angles(series, [2], "camera ", start_ns)],
        )
    yield Plot(
        "What the filter believes of the camera's pose",
        f"One standard deviation under {best.method}; the rotation about down is the heading's.",
        [_sigmas(best, start_ns)],
    )
    if best.innovations:
        yield Plot(
            "Innovations and test ratios",
            f"Under {best.method}: what each measurement said beyond the prediction (north, east, "
            "down in blue, orange, green), and its square over the gate; above 1 it is refused.",
            [_innovations(source, start_ns) for source in best.innovations],
        )


def _angles(
    series: dict[str, AttitudeSeries], which: range | list[int], of: str, start_ns: int
) -> bytes:
    """Return an SVG of two series' angles, one panel for each of ``which``."""
    height_in = 5.6 if len(which) > 1 else 3.0
    made, panels = figure(WIDTH_IN, height_in, len(which), 1, sharex=True, squeeze=False)
    for k, panel in zip(which, panels[:, 0], strict=True):
        for (name, one), colour in zip(series.items(), (COLOURS[1], COLOURS[0]), strict=True):
            if len(one):
                panel.plot(*_degrees(one, k, start_ns), color=colour, label=name)
        panel.set_ylabel(f"{of}{_AXES[k]}, deg")
    panels[0, 0].legend(ncols=2)
    panels[-1, 0].set_xlabel("time, s")
    return svg(made)


def _degrees(attitudes: AttitudeSeries, axis: int, start_ns: int) -> tuple[Array, Array]:
    """Return times (s) and an angle (deg), a heading in 0 to 360 with nan where it wraps."""
    keep = thinned(len(attitudes))
    angle = np.degrees(attitudes.rpy[keep, axis])
    if axis == 2:
        angle %= 360.0
        angle = np.where(np.abs(np.diff(angle, prepend=angle[:1])) > 180.0, np.nan, angle)
    return _seconds(attitudes.stamp_ns, start_ns), np.asarray(angle, float)


def _seconds(stamp_ns: IntArray, start_ns: int) -> Array:
    """Return the times (s) of the instants that are shown."""
    return np.asarray((stamp_ns[thinned(len(stamp_ns))] - start_ns) * 1e-9, float)


def _corrections(autopilot: AttitudeSeries, body: AttitudeSeries, start_ns: int) -> bytes:
    keep = (body.stamp_ns >= autopilot.stamp_ns[0]) & (body.stamp_ns <= autopilot.stamp_ns[-1])
    stamps = body.stamp_ns[keep]
    before = [np.interp(stamps, autopilot.stamp_ns, np.unwrap(angle)) for angle in autopilot.rpy.T]
    corrections = np.degrees(wrap_pi(body.rpy[keep] - np.stack(before, axis=-1)))
    made, axes = figure(WIDTH_IN, 3.0)
    for k, name in enumerate(_AXES):
        shown = corrections[thinned(len(stamps)), k]
        axes.plot(_seconds(stamps, start_ns), shown, color=COLOURS[2 - k], label=name)
    axes.set(xlabel="time, s", ylabel="correction, deg")
    axes.legend(ncols=3)
    return svg(made)


def _sigmas(best: MethodResult, start_ns: int) -> bytes:
    poses = best.camera if len(best.camera) else best.body
    made, panels = figure(WIDTH_IN, 4.2, 2, 1, sharex=True)
    for panel, sigmas, label in (
        (panels[0], poses.sigma_position_n, "position, m"),
        (panels[1], np.degrees(poses.sigma_attitude_n), "rotation about, deg"),
    ):
        for k, name in enumerate(("north", "east", "down")):
            shown = sigmas[thinned(len(poses)), k]
            panel.plot(_seconds(poses.stamp_ns, start_ns), shown, color=COLOURS[k], label=name)
        panel.set(ylabel=label)
        logarithmic(panel, "y")
    panels[0].legend(ncols=3)
    panels[1].set(xlabel="time, s")
    return svg(made)


def _innovations(source: Innovations, start_ns: int) -> bytes:
    """Return an SVG: the innovations of one source above their test ratios."""
    made, (above, below) = figure(WIDTH_IN, 3.4, 2, 1, sharex=True)
    keep, t_s = thinned(len(source.stamp_ns)), _seconds(source.stamp_ns, start_ns)
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
