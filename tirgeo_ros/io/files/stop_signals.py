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
"""Name the signals that stop a program; alone, as nodes block them before anything else."""

from __future__ import annotations

import signal


def stop_signals() -> tuple[signal.Signals, ...]:
    """Return SIGINT, SIGTERM and SIGHUP (the terminal was closed).

    SIGHUP is left out if it is ignored: that is how nohup keeps a program running. SIGINT is
    included even if it is ignored, as it is in everything that a shell starts in the background.
    """
    always = (signal.SIGINT, signal.SIGTERM)
    kept = signal.getsignal(signal.SIGHUP) == signal.SIG_IGN
    return always if kept else (*always, signal.SIGHUP)
