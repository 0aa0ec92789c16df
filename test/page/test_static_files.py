"""What the browser gets: whole, from here alone, and nothing that the security policy refuses."""

from __future__ import annotations

import hashlib
import re

import pytest
from project import PROJECT

from tirgeo_ros.core.targets.target import KINDS

STATIC = PROJECT / "tirgeo_ros/page/static"
INDEX = (STATIC / "index.html").read_text()
OWN = sorted([*STATIC.glob("js/**/*.js"), *STATIC.glob("style/*.css")])
#: Of Leaflet 1.9.4 as npm and PyPI have it.
LEAFLET = "db49d009c841f5ca34a888c96511ae936fd9f5533e90d8b2c4d57596f4e5641a"


def name(path):
    return str(path.relative_to(STATIC))


@pytest.mark.parametrize("module", STATIC.glob("js/**/*.js"), ids=name)
def test_imports_lead_to_files(module):
    imports = re.findall(r'(?:from|^import) "([^"]+)";', module.read_text(), re.MULTILINE)
    assert [one for one in imports if not (module.parent / one).is_file()] == []


def test_every_module_is_reached():
    reached, waiting = set(), {STATIC / "js/main.js"}
    while waiting:
        module = waiting.pop().resolve()
        reached.add(module)
        imports = re.findall(r'(?:from|^import) "([^"]+)";', module.read_text(), re.MULTILINE)
        waiting |= {(module.parent / one).resolve() for one in imports} - reached
    assert {path.resolve() for path in STATIC.glob("js/**/*.js")} <= reached


def test_the_page_names_files_that_exist():
    named = re.findall(r'(?:href|src)="/static/([^"]+)"', INDEX)
    assert named
    assert [one for one in named if not (STATIC / one).is_file()] == []
    assert {f"style/{path.name}" for path in STATIC.glob("style/*.css")} <= set(named)


def test_the_page_has_no_inline_script_or_style():
    assert re.findall(r"<style|\sstyle=|\son[a-z]+=|<script(?![^>]*\ssrc=)", INDEX) == []


@pytest.mark.parametrize("path", OWN, ids=name)
def test_data_never_become_markup_and_nothing_comes_from_elsewhere(path):
    text = path.read_text().replace("http://www.w3.org/2000/svg", "")
    refused = (
        r"\.(?:innerHTML|outerHTML)\b|insertAdjacentHTML|document\.write|\beval\(|https?://\w"
    )
    assert re.findall(refused, text) == []
    assert len(text.splitlines()) <= 300


def test_every_kind_and_button_has_its_symbol():
    symbols = set(re.findall(r'<symbol id="icon-(\w+)"', INDEX))
    text = "".join(path.read_text() for path in STATIC.glob("js/**/*.js"))
    used = set(re.findall(r'\b(?:icon|button)\(\s*"(\w+)"', text))
    assert used | set(KINDS) <= symbols


def test_leaflet_is_unchanged_and_has_its_licence():
    folder = STATIC / "vendor/leaflet"
    assert hashlib.sha256((folder / "leaflet.js").read_bytes()).hexdigest() == LEAFLET
    assert "BSD 2-Clause" in (folder / "LICENSE").read_text()
