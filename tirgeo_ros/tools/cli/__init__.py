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
r"""The command ``tirgeo VERB``: one module of this package a verb.

Every module here, except ``main`` and those whose names begin with ``_``, is the verb of its name
(``import_`` is ``import``). Its docstring is the verb's help: a first line for the list of verbs,
a description, and ``example:``. It has::

    OPTIONS = (*FLIGHT, *PARAMETERS, ("--plot", "PNG", "picture of the result"))

    def run(args: Namespace) -> dict[str, object] | int: ...

    def describe(result: dict[str, object]) -> str: ...  # optional: the result for a person

``_verb`` defines what an option is, and the options that verbs share; it adds ``--json`` to every
verb, and calls the tool that does the work. ``main`` runs a verb, and handles result and errors:

- A ``dict`` from ``run`` is the result. It is printed by ``describe`` (else one line per key) or,
  with ``--json``, as one JSON object: NaN and infinities as null, arrays as lists, paths as
  strings. A key ``error`` that is not None means that there is a result but the work is incomplete
  (a damaged bag, read as far as possible): it is also printed on stderr, and the exit code is 1.
- An ``int`` from ``run`` is the exit code of a verb that prints its own output.
- A TirgeoError (or an OSError: no such file, disk full) is one line ``tirgeo VERB: message`` on
  stderr and exit code 1. Wrong use is 2: argparse, or ``raise UsageError(message)``. Ctrl-C is
  130, SIGTERM 143, SIGHUP 129 (unless nohup made it ignored): all unwind the stack, so that
  context managers clean up. Any other exception is a bug and keeps its traceback.

A package without ``run`` (``calibrate``) has sub-verbs: its modules, which have the same form.

A verb's module imports heavy modules (NumPy, OpenCV, rclpy, tirgeo_ros.core.config) only within
``run``, so that ``tirgeo --help`` is quick.
"""
