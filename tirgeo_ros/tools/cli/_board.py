"""Define the arguments that all calibrations with a checkerboard share."""

from __future__ import annotations

import argparse
from pathlib import Path


def add_pictures(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the pictures."""
    parser.add_argument(
        "pictures",
        type=Path,
        nargs="+",
        metavar="PICTURES",
        help="pictures of 8 or 16 bits, folders of them, or one bag (.mcap) with thermal video",
    )
    parser.add_argument("--namespace", default="", metavar="NS", help="of the bag's topics")


def add_board(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the board."""
    parser.add_argument(
        "--board",
        required=True,
        metavar="COLUMNSxROWS",
        help="inner corners of the board, as 9x6: one less each way than squares",
    )
    parser.add_argument(
        "--square", type=float, required=True, metavar="M", help="side of a square, m"
    )
