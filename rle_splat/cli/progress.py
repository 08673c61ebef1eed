"""A progress line on stderr."""

from __future__ import annotations

import shutil
import sys
import time
from contextlib import contextmanager

from ..runtime.steps import drain, forward

REDRAW_INTERVAL = 0.1  # seconds between redraws with the same message; a new message shows at once


class ProgressLine:
    """A progress line, as a context manager that clears the line at its end.

    Parameters
    ----------
    wanted : bool or None
        Whether to show the line; None shows it only if the stream is a terminal.
    stream : file, optional
        Where to write; default stderr.

    Examples
    --------
    ``with ProgressLine(None) as line: line.show(0.3, "reading")``
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
        """Show a message.

        Parameters
        ----------
        fraction : float or None
            Part of the work that is done, 0 to 1; None if unknown.
        message : str
            What is being done.
        """
        now = time.perf_counter()
        if message == self._message and now - self._time < REDRAW_INTERVAL:
            return
        self._message, self._time = message, now
        self._draw(message if fraction is None else f"{100.0 * fraction:3.0f}%  {message}")

    def follow(self, steps, start: float = 0.0):
        """Run a generator of Progress to its end and show each step; return the generator's result.

        Parameters
        ----------
        steps : generator
            Yields Progress.
        start : float
            Where its fractions begin on the line; they fill [start, 1].
        """

        def show(progress):
            self.show(start + (1.0 - start) * progress.fraction, progress.message)

        try:
            return drain(forward(steps), show)
        finally:
            steps.close()

    @contextmanager
    def compiling(self):
        """Context manager: show a message while kernels are compiled, which happens only once but is slow."""
        from ..runtime.jit import compiled, while_compiling

        if not compiled() or not self._on:
            yield
            return
        with while_compiling(lambda: self.show(None, "compiling (first run only)")):
            yield

    def clear(self) -> None:
        """Clear the line, before something is printed."""
        self._message = None
        self._draw("")

    def _draw(self, text: str) -> None:
        if not self._on or (not text and not self._shown):
            return
        text = text[: shutil.get_terminal_size().columns - 1]
        self._stream.write("\r" + text.ljust(self._shown) + ("" if text else "\r"))
        self._stream.flush()
        self._shown = len(text)
