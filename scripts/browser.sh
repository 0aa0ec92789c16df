#!/bin/sh
# Copyright 2026 The tirgeo maintainers
# SPDX-License-Identifier: Apache-2.0

# Installs Debian's Chromium, for the tests of the operator's page, where there is no browser yet.
# Only root can; anyone else is told what to do.
set -eu
for name in chromium chromium-browser google-chrome; do
    if command -v "$name" >/dev/null; then exit 0; fi
done
if [ "$(id -u)" != 0 ] || ! command -v apt-get >/dev/null; then
    echo "tirgeo: the tests of the operator's page need a browser: install chromium" \
        "(Debian: sudo apt install chromium)" >&2
    exit 1
fi
echo "tirgeo: installing Debian's chromium, for the tests of the operator's page" >&2
export DEBIAN_FRONTEND=noninteractive
apt-get -qq update
apt-get -qq install --yes --no-install-recommends chromium >/dev/null
