"""The check for wheels on ARM64: what it asks for, its table and its exit code, without pip."""

from __future__ import annotations

import pytest
from project import PROJECT

from dev import arm64_wheels
from dev.arm64_wheels import PYTHONS, found_for, main, requirements


def test_what_setup_py_requires_is_asked_for_but_not_ros():
    wanted = requirements(PROJECT / "setup.py")
    assert {"numpy>=1.26", "lz4", "rasterio>=1.3"} <= set(wanted)
    assert not [each for each in wanted if each.startswith("ros-")]


@pytest.fixture
def index(monkeypatch):
    """Wheels by Python; pip finds all that it is asked for, or nothing."""
    wheels = {python: {"pyyaml": "6.0", "lz4": "4.4"} for python in PYTHONS}

    def versions(wanted, python):
        names = {arm64_wheels._plain(each.partition(">")[0]) for each in wanted}
        have = wheels[python]
        return {name: have[name] for name in names} if names <= set(have) else {}

    monkeypatch.setattr(arm64_wheels, "versions", versions)
    return wheels


def test_only_the_wheel_that_is_missing_is_named(index):
    del index["3.13"]["lz4"]
    assert found_for(["PyYAML>=5.4", "lz4"], "3.12") == {"PyYAML>=5.4": "6.0", "lz4": "4.4"}
    assert found_for(["PyYAML>=5.4", "lz4"], "3.13") == {"PyYAML>=5.4": "6.0", "lz4": "none"}


@pytest.mark.parametrize("missing", [False, True])
def test_the_table_has_a_column_a_python_and_a_missing_wheel_is_an_exit_code(
    index, tmp_path, capsys, missing
):
    setup_py = tmp_path / "setup.py"
    setup_py.write_text(
        "from setuptools import setup\n"
        "setup(install_requires=['lz4'], extras_require={'x': ['PyYAML>=5.4'], 'ros': ['rclpy']})"
    )
    if missing:
        del index["3.10"]["lz4"]
    assert main([str(setup_py)]) == int(missing)
    head, lz4, yaml, last = capsys.readouterr().out.splitlines()
    assert [python in head for python in PYTHONS] == [True] * 4
    assert lz4.split() == ["lz4", "none" if missing else "4.4", "4.4", "4.4", "4.4"]
    assert yaml.split() == ["PyYAML>=5.4", *["6.0"] * 4]
    assert last.startswith(f"{int(missing)} missing")


def test_a_pip_that_fails_otherwise_is_no_missing_wheel(monkeypatch, capsys):
    def refuse(*_):
        raise OSError("pip: no network")

    monkeypatch.setattr(arm64_wheels, "versions", refuse)
    assert main([str(PROJECT / "setup.py")]) == 2
    assert "no network" in capsys.readouterr().err
