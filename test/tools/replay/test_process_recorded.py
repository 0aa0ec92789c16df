"""tirgeo process of bags as recorders leave them: the same bytes as from one MCAP file."""

from __future__ import annotations

import hashlib

import pytest
from process_bags import same
from recorded_bags import record

from tirgeo_ros.core.types.errors import BagError
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.tools.cli.main import main
from tirgeo_ros.tools.replay.process import process

FORMS = (
    "made_db3",
    "made_db3_split",
    "made_db3_split_zstd_file",
    "made_db3_zstd_file",
    "made_db3_zstd_message",
    "made_mcap",
    "made_mcap_split",
    "made_mcap_zstd_file",
    "made_mcap_zstd_message",
    "made_mcap_zstd_storage",
)
REAL = {
    "real_mcap_bag_with_topics_and_service_events": 10,
    "real_mcap_cdr_test": 7,
    "real_mcap_split_no_metadata": 3177,
    "real_mcap_wbag": 6074,
    "real_sqlite3_bag_with_topics_and_service_events": 10,
    "real_sqlite3_cdr_test": 7,
    "real_sqlite3_wbag": 6074,
}


def digest(bag, out, options):
    summary = process(bag, out, **options)
    assert summary["error"] is None
    return hashlib.sha256(out.read_bytes()).hexdigest()


@pytest.fixture(scope="session")
def recorded(shared):
    """The folder of rosbag2's bags by other writers."""
    return shared / "foreign_logs" / "rosbag2"


@pytest.fixture(scope="module")
def of_one_file(recorded, options, tmp_path_factory):
    """The messages of the single MCAP file, and the digest of what process makes of it."""
    path = recorded / "made_mcap" / "made_mcap.mcap"
    out = tmp_path_factory.mktemp("one") / "out.mcap"
    return list(map(same, BagReader(path).messages())), digest(path, out, options)


@pytest.mark.parametrize("form", FORMS)
def test_the_same_bytes_from_every_form(recorded, of_one_file, options, tmp_path, form):
    messages, expected = of_one_file
    assert list(map(same, BagReader(recorded / form).messages())) == messages
    assert digest(recorded / form, tmp_path / "out.mcap", options) == expected


@pytest.mark.parametrize("name", REAL)
def test_bags_of_other_topics_are_read_and_refused(recorded, options, tmp_path, name):
    reader = BagReader(recorded / name)
    assert sum(1 for _ in reader.messages()) == REAL[name]
    assert reader.damage is None
    with pytest.raises(BagError, match=rf"{name}: needed topic absent: /imu/data, /rtk/fix or"):
        process(recorded / name, tmp_path / "out.mcap", **options)


def test_the_same_bytes_from_a_recording_in_parts(cut, whole, options, tmp_path):
    messages = list(BagReader(cut).messages())
    parts = [messages[:300], messages[300:301], messages[301:]]
    folder = record(tmp_path / "bag", parts, "sqlite3", "file")
    process(folder, tmp_path / "out.mcap", raw_images=True, **options)
    assert (tmp_path / "out.mcap").read_bytes() == (whole[0] / "out.mcap").read_bytes()


def test_an_absent_part_is_told(cut, options, tmp_path, capsys):
    messages = list(BagReader(cut).messages())
    folder = record(tmp_path / "bag", [messages[:600], messages[600:]])
    (folder / "bag_1.mcap").unlink()
    words = ["process", str(folder), "-o", str(tmp_path / "out.mcap"), "--no-images"]
    assert main([*words, "--params", str(options["params"])]) == 1
    told = capsys.readouterr().err
    assert "bag: bag_1.mcap, named in metadata.yaml, is absent; " in told
    assert told.count("\n") == 1


def test_no_part_of_the_input_is_overwritten(cut, tmp_path):
    folder = record(tmp_path / "bag", [list(BagReader(cut).messages())])
    with pytest.raises(BagError, match=r"bag_0\.mcap: would overwrite the input .*bag_0\.mcap;"):
        process(folder, folder / "bag_0.mcap")
