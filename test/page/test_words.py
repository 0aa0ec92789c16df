# Copyright 2026 The tirgeo maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""The page's dictionaries: complete, alike, used, and with the fixed texts of the server."""

from __future__ import annotations

import json
import re

import pytest
from project import PROJECT

from tirgeo_ros.core.ground.backprojection import Reason
from tirgeo_ros.core.targets.target import KINDS
from tirgeo_ros.core.types import verdicts
from tirgeo_ros.core.types.measurements import FixStatus

STATIC = PROJECT / "tirgeo_ros/page/static"
SOURCES = [STATIC / "index.html", *(STATIC / "js").rglob("*.js")]
LANGUAGES = ("de", "en", "es", "fr")
ENTRY = re.compile(r'^  (".+"): (".*"),$', re.MULTILINE)
PLACE = re.compile(r"\{\w+\}")
SAID = "said."
#: How sources name a key: t("..."), attributes of index.html, and lists of the help.
NAMED = re.compile(r'\bt\(\s*"([^"]+)"|data-(?:words|label)="([^"]+)"|"(help\.[\w.]+)"')
#: Words for people that are written in a source; "mark" is sent, not shown.
WRITTEN = re.compile(
    r'(?<!data-)\b(?:text|label|title|placeholder|aria-label|alt)"?[:=]\s*["`](?!mark")[A-Za-z]'
)


def entries(language):
    """Return the entries of a dictionary, in its order."""
    text = (STATIC / f"js/words/{language}.js").read_text("utf-8")
    found = [(json.loads(key), json.loads(words)) for key, words in ENTRY.findall(text)]
    assert len(found) == len(re.findall(r"^  \S", text, re.MULTILINE)), "one entry, one line"
    return found


def own(language):
    """Return the words of the page itself, by key."""
    return {key: words for key, words in entries(language) if not key.startswith(SAID)}


def said(language):
    """Return the server's texts in a language, by the English text."""
    return {k.removeprefix(SAID): v for k, v in entries(language) if k.startswith(SAID)}


def sources():
    return {path: path.read_text("utf-8") for path in SOURCES if path.parent.name != "words"}


@pytest.mark.parametrize("language", LANGUAGES)
def test_a_dictionary_has_each_key_once_in_order_with_the_same_places(language):
    keys = [key for key, _ in entries(language)]
    assert keys == sorted(set(keys))
    english, words = own("en"), own(language)
    assert words.keys() == english.keys()
    for key, text in words.items():
        assert text.strip(), key
        assert sorted(PLACE.findall(text)) == sorted(PLACE.findall(english[key])), key


@pytest.mark.parametrize(
    ("language", "card"), [("de", "Karteikarte"), ("fr", "fiche"), ("es", "ficha")]
)
def test_a_targets_card_is_not_called_a_map(language, card):
    """In German one word means both."""
    words = own(language)
    of_cards = [key for key, text in own("en").items() if re.search(r"\bcard\b", text)]
    assert [key for key in of_cards if card not in words[key]] == []


@pytest.mark.parametrize("language", ["de", "fr", "es"])
def test_a_text_that_is_left_out_is_not_a_target_that_is_dismissed(language):
    left_out = own(language)["change.left_out"].lower()
    assert said(language)["dismissed"] not in left_out
    assert "text" in left_out


def test_sources_name_keys_that_are_there_and_none_is_unused():
    named = {key for text in sources().values() for found in NAMED.findall(text) for key in found}
    assert named - {""} == own("en").keys()


def test_no_source_has_words_of_its_own():
    found = {path.name: WRITTEN.findall(text) for path, text in sources().items()}
    assert {name: words for name, words in found.items() if words} == {}


def test_texts_of_the_server_have_the_same_keys_and_places():
    assert said("en") == {}
    for language in ("de", "es", "fr"):
        texts = said(language)
        assert texts.keys() == said("de").keys()
        for english, words in texts.items():
            assert sorted(PLACE.findall(words)) == sorted(PLACE.findall(english)), english


def test_each_fixed_text_of_the_server_is_translated():
    view = (PROJECT / "tirgeo_ros/nodes/aircraft_view.py").read_text("utf-8")
    fixed = {
        *(reason.value for reason in Reason),
        *(state.value.replace("_", " ") for state in verdicts.FilterState),
        *verdicts._STATES.values(),
        *verdicts._AGAIN.values(),
        *(status.name.lower() for status in FixStatus),
        *KINDS,
        *re.findall(r'Verdict\("([A-Z ]+)"', view),
        "NO VIDEO",
    }
    assert fixed <= said("de").keys()
