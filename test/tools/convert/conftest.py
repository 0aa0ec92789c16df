"""A folder with the parameters of the imported flights."""

from __future__ import annotations

import pytest
from ros1_bags import parameters_file


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("ros1")
    parameters_file(folder / "params.yaml")
    return folder
