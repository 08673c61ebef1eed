"""One line on stderr that says how far long work has come."""

from __future__ import annotations

import shutil
import sys
import time
from contextlib import contextmanager

from ..runtime.steps import drain

# A line is redrawn at most this often, in seconds, so that a terminal costs nothing; a new message shows at once.
REDRAW_INTERVAL = 0.1


class ProgressLine:
    """``with ProgressLine(wanted) as line: line.show(0.3, "reading")``; cleared at the end.

    ``wanted`` None shows it only where stderr is a terminal.
    """

    def __init__(self, wanted=None, stream=None):
        self._stream = sys.stderr if stream is None else stream
        self._on = self._stream.isatty() if wanted is None else bool(wanted)
        self._shown, self._message, self._time = 0, None, 0.0

    def __enter__(self):
        return self

    def __exit__(self, *problem):
        self._draw("")
        return False

    def show(self, fraction, message: str) -> None:
        """Draw ``message`` with ``fraction`` of the work done, 0 to 1, or None where that is unknown."""
        now = time.perf_counter()
        if message == self._message and now - self._time < REDRAW_INTERVAL:
            return
        self._message, self._time = message, now
        self._draw(message if fraction is None else f"{100.0 * fraction:3.0f} %  {message}")

    def follow(self, steps, start: float = 0.0):
        """Run a generator of Progress to its end and return its value; its fractions fill [start, 1]."""
        try:
            return drain(steps, lambda step: self.show(start + (1.0 - start) * step.fraction, step.message))
        finally:
            steps.close()

    @contextmanager
    def compiling(self):
        """While this is open the line says when kernels are compiled, which takes a while but happens once."""
        from ..runtime.jit import compiled, while_compiling

        if not compiled() or not self._on:
            yield
            return
        with while_compiling(lambda: self.show(None, "compiling kernels (first run only)")):
            yield

    def _draw(self, text: str) -> None:
        if not self._on or (not text and not self._shown):
            return
        text = text[: shutil.get_terminal_size().columns - 1]
        self._stream.write("\r" + text.ljust(self._shown) + ("" if text else "\r"))
        self._stream.flush()
        self._shown = len(text)
