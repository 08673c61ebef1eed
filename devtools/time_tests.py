"""A plugin of pytest that says where a run's processor time goes: the most expensive tests and the compiled kernels.

.venv/bin/python -m pytest -q -p devtools.time_tests tests/effects
"""

from __future__ import annotations

import os
import time
from collections import Counter

import pytest
from numba.core import event

SHOWN = 40  # tests and kernels


class CompileTimes(event.Listener):
    """Sums the processor time that numba compiles, and counts combinations of argument types, by the kernel's name.

    A kernel that is compiled while another one is counts as part of the outer one.
    """

    def __init__(self):
        self.seconds, self.counts = Counter(), Counter()
        self._depth, self._began = 0, 0.0

    def on_start(self, event):
        if self._depth == 0:
            self._began = time.thread_time()
        self._depth += 1

    def on_end(self, event):
        self._depth -= 1
        if self._depth == 0:
            function = event.data["dispatcher"].py_func
            name = f"{function.__module__}.{function.__qualname__}"
            self.seconds[name] += time.thread_time() - self._began
            self.counts[name] += 1


COMPILED = CompileTimes()
TESTS = Counter()  # processor time by test, with its fixtures and its child processes
COMPILING = Counter()  # the part of it in which this process compiled


def _processor_seconds() -> float:
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def pytest_configure(config):
    event.register("numba:compile", COMPILED)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item):
    before, compiled = _processor_seconds(), COMPILED.seconds.total()
    try:
        return (yield)
    finally:
        TESTS[item.nodeid] += _processor_seconds() - before
        COMPILING[item.nodeid] += COMPILED.seconds.total() - compiled


def _files(tests: Counter) -> Counter:
    """The sums of the files of these tests."""
    sums = Counter()
    for name, seconds in tests.items():
        sums[name.partition("::")[0]] += seconds
    return sums


def pytest_terminal_summary(terminalreporter):
    write = terminalreporter.write_line
    write(f"{TESTS.total():.0f} s of processor time in tests, {COMPILED.seconds.total():.0f} s of it compiling")
    for title, sums, parts in (("file", _files(TESTS), _files(COMPILING)), ("test", TESTS, COMPILING)):
        write(f"seconds  compiling  {title}")
        for name, seconds in sums.most_common(SHOWN):
            write(f"{seconds:7.1f}  {parts[name]:9.1f}  {name}")
    write("seconds   versions  kernel")
    for name, seconds in COMPILED.seconds.most_common(SHOWN):
        write(f"{seconds:7.1f}  {COMPILED.counts[name]:9d}  {name}")
