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
"""Read a page as a machine does: tags that close in their order, sources, text."""

from __future__ import annotations

import base64
from html.parser import HTMLParser

_VOID = {"meta", "img", "link", "br", "hr", "input", "wbr", "polyline", "circle", "path"}


class Page(HTMLParser):
    """Tags that are closed in their order, pictures and links, headings, text."""

    def __init__(self, text):
        super().__init__()
        self.open, self.sources, self.text = [], [], []
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        if tag not in _VOID:
            self.open.append(tag)
        self.sources += [value for name, value in attrs if name in {"src", "href"}]

    def handle_startendtag(self, tag, attrs):
        """A tag that closes itself, as in SVG."""

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)


def embedded(page, kind):
    """Return the contents of a page's pictures of a type."""
    lead = f"data:{kind};base64,"
    return [base64.b64decode(s.removeprefix(lead)) for s in page.sources if s.startswith(lead)]
