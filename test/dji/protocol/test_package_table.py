"""Tables of packages as a person writes them."""

from __future__ import annotations

import pytest

from tirgeo_ros.core.types.errors import DjiError
from tirgeo_ros.dji.protocol.package_table import package_table
from tirgeo_ros.dji.protocol.subscription import Package
from tirgeo_ros.io.parameters.parameter_file import load_yaml

FILE = "packages.yaml"


def entry(**changes):
    return {"rate_hz": 5, "with_timestamp": True, "topics": ["RTK_POSITION", "RTK_YAW"]} | changes


def without(key):
    return {name: value for name, value in entry().items() if name != key}


def test_a_table_is_read_from_a_file(tmp_path):
    file = tmp_path / FILE
    file.write_text(
        "packages:\n"
        "  0:\n"
        "    rate_hz: 5\n"
        "    with_timestamp: true\n"
        "    topics: [RTK_POSITION, 0xf45d73fd]\n"
        "  3:\n"
        "    rate_hz: 400\n"
        "    with_timestamp: false\n"
        "    topics:\n"
        "      - HARD_SYNC\n"
    )
    assert list(package_table(load_yaml(file), str(file)).values()) == [
        Package.of(0, 5, with_timestamp=True, names=("RTK_POSITION", "RTK_YAW")),
        Package.of(3, 400, with_timestamp=False, names=("HARD_SYNC",)),
    ]


@pytest.mark.parametrize(
    ("tree", "message"),
    [
        (None, "no table of packages"),
        ({"package": {}}, "no table of packages"),
        ({"packages": None}, "no table of packages"),
        ({"packages": {5: entry()}}, r"packages\.5: ids of packages are 0 to 4"),
        ({"packages": {"a": entry()}}, r"packages\.a: ids of packages are 0 to 4"),
        ({"packages": {1: ["RTK_YAW"]}}, r"packages\.1: needs rate_hz, with_timestamp, topics"),
        (
            {"packages": {1: without("topics")}},
            r"packages\.1: needs rate_hz, with_timestamp, topics",
        ),
        ({"packages": {1: entry(rate=5)}}, r"packages\.1: needs .*, and nothing else"),
        ({"packages": {1: entry(rate_hz=401)}}, r"packages\.1\.rate_hz: 401: a whole number"),
        ({"packages": {1: entry(rate_hz=5.5)}}, r"packages\.1\.rate_hz: 5\.5: a whole number"),
        ({"packages": {1: entry(with_timestamp=1)}}, r"packages\.1\.with_timestamp: 1: true or"),
        ({"packages": {1: entry(topics=[])}}, r"packages\.1\.topics: a list of topics"),
        (
            {"packages": {1: entry(topics=["RTK_JAW"])}},
            r"packages\.1\.topics: unknown topic RTK_J",
        ),
        ({"packages": {1: entry(topics=[18])}}, r"packages\.1\.topics: unknown topic 0x00000012"),
        ({"packages": {1: entry(topics=[None])}}, r"packages\.1\.topics: unknown topic None"),
        (
            {
                "packages": {
                    1: entry(
                        topics=[
                            *("ESC_DATA", "HARD_SYNC", "RC_FULL_RAW_DATA", "GPS_DETAILS"),
                            *("QUATERNION", "GPS_FUSED"),
                        ]
                    )
                }
            },
            r"packages\.1: 261 bytes, more than the 250 of a push",
        ),
    ],
)
def test_what_is_no_table_is_told_with_file_and_key(tree, message):
    with pytest.raises(DjiError, match=rf"^{FILE}: {message}"):
        package_table(tree, FILE)
