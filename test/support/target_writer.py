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
"""Edit targets one after another, and say on stdout which edit is confirmed.

python target_writer.py FILE EDITS: the edits are the same in each run, but for the targets' ids.
"""

from __future__ import annotations

import dataclasses
import random
import sys

from target_samples import click

from tirgeo_ros.core.targets.target import KINDS
from tirgeo_ros.io.targets.store import TargetStore

JPEG = b"\xff\xd8" + bytes(3000)


def edit(store, number):
    """Make the edit with a number."""
    rng = random.Random(number)
    known = store.all()
    what = rng.choice(["add", "add", "refine", "edit", "edit", "delete", "undo"])
    if what == "undo" and number > 20:
        store.undo()
    elif what in {"add", "undo"} or not known:
        picture = rng.choice([None, JPEG])
        store.add(click(number, 3), kind=rng.choice(KINDS), picture=picture, now_ns=number)
    else:
        item = rng.choice(known)
        if what == "delete":
            store.delete(item.id, number)
        elif what == "edit" or len(item.clicks) > 9:
            store.edit(item.id, number, name=f"name {number}", note="n" * rng.randrange(2000))
        else:
            store.refine(item.id, click(number, 2, after_s=number), number)


def state_of(store):
    """What the store holds, without ids."""
    return [dataclasses.replace(target, id="") for target in store.all()]


if __name__ == "__main__":
    opened = TargetStore(sys.argv[1])
    for k in range(int(sys.argv[2])):
        edit(opened, k)
        sys.stdout.write(f"{k}\n")
        sys.stdout.flush()
