"""Pages that are served while a file of tests runs."""

from __future__ import annotations

import pytest
from page_clients import TOKENS, Served


@pytest.fixture(scope="module")
def served(tmp_path_factory):
    """A page on this computer alone: no token."""
    with Served(tmp_path_factory.mktemp("page")) as one:
        yield one


@pytest.fixture(scope="module")
def guarded(tmp_path_factory):
    """A page that other computers reach: with tokens."""
    with Served(tmp_path_factory.mktemp("page"), **TOKENS) as one:
        yield one
