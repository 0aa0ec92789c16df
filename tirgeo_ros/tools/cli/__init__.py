r"""The command ``tirgeo VERB``: one module of this package a verb.

Every module here but ``main`` and those that begin with ``_`` is a verb of its own name
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
    # an option of its own with dest="describe" (-v of process) puts another in its place

``main`` adds ``--json`` to every verb and does all the rest:

- A ``dict`` from ``run`` is the result. It is printed by ``describe`` (else a line a key) or, with
  ``--json``, as one JSON object: NaN and infinities as null, arrays as lists, paths as strings.
  A key ``error`` that is not None means that a result exists but the work is not whole (a damaged
  bag, read as far as it goes): it also goes to stderr, and the exit code is 1.
- An ``int`` from ``run`` is the exit code of a verb that has printed for itself.
- A TirgeoError (or an OSError: no such file, disk full) is one line ``tirgeo VERB: message`` on
  stderr and exit code 1. Wrong use is 2: argparse, or ``raise UsageError(message)``. Ctrl-C is
  130, SIGTERM 143, SIGHUP 129 (unless nohup had it ignored): all unwind the stack, so that context
  managers tidy up. Anything else is a bug and keeps its traceback.
- ``Subparsers`` and ``UsageError`` come from ``tirgeo_ros.tools.cli._verb``.

A verb without ``run`` has verbs of its own (``calibrate``): ``add_parser`` declares them, each by
a module of the same form, and calls ``complete`` of ``_verb`` for each.

A verb's module imports nothing heavy (NumPy, OpenCV, rclpy, tirgeo_ros.core.config) but within
``run``, so that ``tirgeo --help`` is quick. Long work shows a ``tools.progress.Progress``.
"""
