"""The option ``--memory-limit``."""

from __future__ import annotations

import argparse
import re
from contextlib import contextmanager

from ..runtime.memory import held_bytes, limit_to

UNITS = {"": 0, "k": 10, "m": 20, "g": 30, "t": 40}  # powers of two of bytes
SIZE = re.compile(r"(\d+(?:\.\d+)?)\s*(?:([kmgt])(?:i?b)?|b)?", re.IGNORECASE)
LEAST = 64 << 20  # bytes that a picture may take, whatever the limit: with less, nothing can be read


def add_memory_limit_option(parser) -> None:
    """Add the option."""
    parser.add_argument(
        "--memory-limit", type=memory_size, metavar="SIZE",
        help="memory that the command may take, such as 2GiB (default: what is free)",
    )


def memory_size(text: str) -> int:
    """Bytes of a size such as 500MB or 2GiB; K, M, G and T are powers of 1024."""
    found = SIZE.fullmatch(text.strip())
    if not found or not float(found[1]) > 0.0:
        raise argparse.ArgumentTypeError(f"{text!r} is not a size of memory; give a number such as 2GiB or 500MB")
    unit = UNITS[(found[2] or "").lower()]
    return int(float(found[1]) * (1 << unit))


@contextmanager
def limited_memory(args):
    """Context manager: as much memory is free as --memory-limit leaves, without the option as there is.

    Yields
    ------
    callable
        Counts anew what the process holds; called after a volume was read.
    """

    def count() -> None:
        limit_to(None if args.memory_limit is None else max(args.memory_limit - held_bytes(), LEAST))

    count()
    try:
        yield count
    finally:
        limit_to(None)
