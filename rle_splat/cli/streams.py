"""Output streams of the process that never keep a command from its work: closed, without a reader, or too narrow."""

import errno
import io
import os
import sys
from contextlib import contextmanager

READER_ENDED = errno.EPIPE, errno.EINVAL  # Windows reports the latter
OUTPUTS = {"stdout": 1, "stderr": 2}  # attribute of sys -> file descriptor


class _Lasting(io.BufferedWriter):
    """What is written after its reader has ended (``| head``) is dropped.

    The file below it is Python's own: one written in Python could be stopped (Ctrl+C) between the system's call and its
    return, and its bytes would be written once more at the end.
    """

    def write(self, data) -> int:
        with _reader_may_end():
            return super().write(data)
        return len(data)

    def flush(self) -> None:
        with _reader_may_end():
            super().flush()


@contextmanager
def _reader_may_end():
    try:
        yield
    except OSError as problem:
        if problem.errno not in READER_ENDED:
            raise


def settle_streams() -> None:
    """Give the process outputs that can be written to.

    A closed descriptor leads to the null device, because the next file that is opened would take its number, and
    messages of libraries would be written into it.  Characters that an encoding lacks are escaped.
    """
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest number that is free: this one
    for name, descriptor in OUTPUTS.items():
        stream = getattr(sys, name)
        if stream is not None and stream.isatty():
            stream.reconfigure(errors="backslashreplace")
            continue
        raw = _Lasting(io.FileIO(descriptor, "wb", closefd=False))
        encoding = "utf-8" if stream is None else stream.encoding
        lines = name == "stderr" or (stream is not None and stream.write_through)  # python -u
        setattr(sys, name, io.TextIOWrapper(raw, encoding, errors="backslashreplace", line_buffering=lines))
