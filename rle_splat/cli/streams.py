"""Output streams of the process that never keep a command from its work: closed, without a reader, or too narrow."""

from __future__ import annotations

import errno
import io
import os
import sys

READER_ENDED = errno.EPIPE, errno.EINVAL  # Windows reports the latter
OUTPUTS = {"stdout": 1, "stderr": 2}  # attribute of sys -> file descriptor


class _Lasting(io.RawIOBase):
    """Writes to a file descriptor; what is written after its reader has ended (``| head``) is dropped."""

    def __init__(self, descriptor: int):
        self._descriptor = descriptor

    def writable(self) -> bool:
        return True

    def fileno(self) -> int:
        return self._descriptor

    def isatty(self) -> bool:
        return os.isatty(self._descriptor)

    def write(self, data) -> int:
        try:
            return os.write(self._descriptor, data)
        except OSError as problem:
            if problem.errno not in READER_ENDED:
                raise
            return len(data)


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
        raw = io.BufferedWriter(_Lasting(descriptor))
        encoding = "utf-8" if stream is None else stream.encoding
        lines = name == "stderr" or (stream is not None and stream.write_through)  # python -u
        setattr(sys, name, io.TextIOWrapper(raw, encoding, errors="backslashreplace", line_buffering=lines))
