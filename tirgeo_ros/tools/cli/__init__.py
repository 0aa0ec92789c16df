r"""The command ``tirgeo VERB``: one module of this package a verb.

Every module here, except ``main`` and those whose names begin with ``_``, is the verb of its name
(``import_`` is ``import``). It has::

    def add_parser(subparsers: Subparsers) -> ArgumentParser:
        parser = subparsers.add_parser(
            "process",
            help="one line for the list of verbs",
            description="a paragraph",
            epilog="example:\n  tirgeo process flight.mcap -o out.mcap",  # needed, kept as it is
        )
        parser.add_argument("bag", ...)
        return parser

    def run(args: Namespace) -> dict[str, object] | int: ...

    def describe(result: dict[str, object]) -> str: ...  # optional: the result for a person
    # an option with dest="describe" (-v of process) replaces it by another function

``main`` adds ``--json`` to every verb, runs it and handles its result and errors:

- A ``dict`` from ``run`` is the result. It is printed by ``describe`` (else one line per key) or,
  with ``--json``, as one JSON object: NaN and infinities as null, arrays as lists, paths as
  strings. A key ``error`` that is not None means that there is a result but the work is incomplete
  (a damaged bag, read as far as possible): it is also printed on stderr, and the exit code is 1.
- An ``int`` from ``run`` is the exit code of a verb that prints its own output.
- A TirgeoError (or an OSError: no such file, disk full) is one line ``tirgeo VERB: message`` on
  stderr and exit code 1. Wrong use is 2: argparse, or ``raise UsageError(message)``. Ctrl-C is
  130, SIGTERM 143, SIGHUP 129 (unless nohup made it ignored): all unwind the stack, so that
  context managers clean up. Any other exception is a bug and keeps its traceback.
- ``Subparsers`` and ``UsageError`` come from ``tirgeo_ros.tools.cli._verb``.

A verb without ``run`` has sub-verbs (``calibrate``): ``add_parser`` declares them, each in a
module of the same form, and calls ``complete`` of ``_verb`` for each.

A verb's module imports heavy modules (NumPy, OpenCV, rclpy, tirgeo_ros.core.config) only within
``run``, so that ``tirgeo --help`` is quick. Long work shows a
``tools.presentation.progress.Progress``.
"""
