"""Flights over surveyed points with planted errors of the camera, for tests of the boresight."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import yaml
from project import PROJECT

from tirgeo_ros.io.bags.bag import BagReader, BagWriter, Cdr
from tirgeo_ros.io.messages import Messages
from tirgeo_ros.io.messages.decode import heading_sample
from tirgeo_ros.tools.calibrate.boresight import (
    calibrate_boresight,
)
from tirgeo_ros.tools.simulate.files import simulate

SCENARIO = PROJECT / "config" / "scenarios" / "paper_flight.yaml"
PLANTED = {"roll": 1.0, "pitch": -0.8, "yaw": 1.5, "latency": 70.0}
OVERLAY = "/**/overlay_node:\n  ros__parameters: "
GIMBAL = "/**/gimbal_node:\n  ros__parameters: "


class Flown:
    """A flight whose truth is known, and its calibration from parameters that are wrong."""

    def __init__(self, folder, source, now, truth):
        (folder / "now.yaml").write_text(now)
        self.folder, self.source, self.truth = folder, source, truth

    def calibrate(self, observations=None, *params, out="found.yaml", **options):
        files = [self.source / "params.yaml", self.folder / "now.yaml"]
        return calibrate_boresight(
            self.source / "flight.mcap",
            self.source / "survey.geojson",
            observations or self.source / "observations.csv",
            self.folder / out,
            params=[*files, *(self.folder / name for name in params)],
            **options,
        )

    def rows(self):
        head, *rows = (self.source / "observations.csv").read_text().splitlines()
        return head, rows

    def halves(self):
        """Two files of observations, each of every other point."""
        head, rows = self.rows()
        ids = sorted({row.partition(",")[0] for row in rows})
        for k in (0, 1):
            part = [row for row in rows if ids.index(row.partition(",")[0]) % 2 == k]
            path = self.folder / f"half{k}.csv"
            path.write_text("\n".join([head, *part]) + "\n")
            yield path

    def errors(self, result):
        """By parameter: found less true, and sigma."""
        return {
            name: (one["found"] - self.truth[name], one["sigma"])
            for name, one in result["parameters"].items()
        }


def planted(folder, seed, now, **changes):
    """A simulated flight with what the requirement plants."""
    tree = yaml.safe_load(SCENARIO.read_text())
    given = {"gimbal.boresight_rpy_deg": [1.0, -0.8, 1.5], "video.latency_s": 0.07}
    for name, value in {**given, **changes}.items():
        group, key = name.split(".")
        tree[group][key] = value
    (folder / "scenario.yaml").write_text(yaml.safe_dump(tree))
    simulate(folder / "scenario.yaml", folder, seed=seed, images=False)
    late = f"{OVERLAY}{{video_latency_s: 0.05}}\n"
    truth = PLANTED | {"gimbal_north": 0.0}
    return Flown(folder, folder, late + GIMBAL + now, truth)


def with_headings_off(folder, off_deg):
    """Let the flight's headings be those that antennas in the wrong place give."""
    path, cdr = folder / "flight.mcap", Cdr()
    messages, whole = Messages(cdr.types), folder / "flight.mcap.whole"
    path.rename(whole)
    with BagWriter(path) as out:
        for item in BagReader(whole).messages():
            data = item.data
            if item.topic == "/rtk/heading":
                sample = heading_sample(cdr.deserialize(data, item.typename))
                off = replace(sample, heading_rad=sample.heading_rad + np.radians(off_deg))
                data = cdr.serialize(messages.heading(off), item.typename)
            out.write(item.topic, item.typename, data, item.log_time_ns)
