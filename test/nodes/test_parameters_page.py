"""docs/parameters.md is what the code makes of its parameters."""

from __future__ import annotations

import yaml
from project import PROJECT

from tirgeo_ros.core.config import NODE_CONFIGS
from tirgeo_ros.core.config.schema import parameters_of
from tirgeo_ros.nodes.help import as_yaml
from tirgeo_ros.nodes.parameters_page import parameters_page


def test_the_page_is_current_and_has_every_parameter():
    page = (PROJECT / "docs" / "parameters.md").read_text()
    assert parameters_page() == page, (
        "docs/parameters.md is not what the code says: make parameters"
    )
    for kind in NODE_CONFIGS.values():
        for one in parameters_of(kind):
            assert f"| `{one.name}` |" in page
            assert one.description in page


def test_defaults_are_read_as_they_are_written():
    for kind in NODE_CONFIGS.values():
        for one in parameters_of(kind):
            if as_yaml(one.default) not in ("unset", "empty"):
                read = yaml.safe_load(as_yaml(one.default))
                assert repr(tuple(read) if isinstance(read, list) else read) == repr(one.default)
