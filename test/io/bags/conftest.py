"""A folder for the temporary files of readers."""

from __future__ import annotations

import tempfile

import pytest


@pytest.fixture
def scratch(tmp_path_factory, monkeypatch):
    """The folder for temporary files."""
    folder = tmp_path_factory.mktemp("scratch")
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    return folder
