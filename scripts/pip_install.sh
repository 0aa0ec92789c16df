#!/bin/sh
# Copyright 2026 The tirgeo maintainers
# SPDX-License-Identifier: Apache-2.0

# Installs with the pip of the virtual environment $1, within its constraints; the rest of the
# arguments is pip's. Makes the environment smaller and compiles it. Pip's own words are shown only
# where they help: without a network one line says so, in seconds instead of pip's minutes and pages.
set -u
venv=$1
shift
said=$(mktemp)
trap 'rm -f "$said"' EXIT

# --no-compile: that is done when what nothing imports is gone.
if PIP_RETRIES=${PIP_RETRIES:-2} PIP_DEFAULT_TIMEOUT=${PIP_DEFAULT_TIMEOUT:-10} \
    "$venv/bin/python" -m pip install --quiet --disable-pip-version-check --no-compile \
    --constraint "$venv/constraints.txt" "$@" >"$said" 2>&1; then
    "$venv/bin/python" "$(dirname "$0")/slim.py"
    # Files that are no Python of this version are among the libraries, as templates: no matter.
    "$venv/bin/python" -m compileall -qq -j 0 -x '/tests/' "$venv/lib" || true
    exit 0
fi
if grep -q 'connection broken by\|timed out\|IncompleteRead\|Connection reset' "$said"; then
    echo "tirgeo: cannot reach the package index: connect this machine to the network (or set" \
        "PIP_INDEX_URL or PIP_PROXY) and run make again" >&2
else
    cat "$said" >&2
    echo "tirgeo: pip could not install the packages (its own words are above)" >&2
fi
exit 1
