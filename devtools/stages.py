"""One stage of the tests: how it is run, what it says, and the table at the end."""

from __future__ import annotations

import json
import os
import re
import subprocess
import time
from collections import Counter
from dataclasses import dataclass, field
from itertools import takewhile
from pathlib import Path

from .places import OUT, ROOT, say

REPORTS = OUT / "test"  # what each stage printed, and pytest's reports

# A stage is stopped when no test begins or ends and nothing is printed for this long.  Each test has its limit
# (pytest-timeout, in pyproject.toml), which is shorter: this one is for scripts without pytest, and for a test that
# hangs where no signal reaches it.
SILENT_SECONDS = 2700
NICENESS = 5  # of stages: the kernels that others wait for are compiled by one process, which needs a whole core
LOOK_SECONDS = 0.2  # between looks at what a stage has printed

CLUES = 12  # lines of a failed stage's log that the end of the run repeats: of a long log often only the end is at hand
LINE = 300  # characters of each
CHECK = re.compile(r".+ passed, [\d.]+ s")  # what a script of a window prints of each check

# Reasons of skips that better environments would end.
_NO_PACKAGE = re.compile(r"could not import|No module named|not installed|not in this environment|UNTESTED")


@dataclass
class Stage:
    """The outcome of one stage.

    ``remarks`` say why something was skipped or what broke.  ``missing``: what the machine lacks to run the stage.
    ``tests``: the reason why each was skipped, "" for one that ran; by pytest's name.  ``clues``: the lines of its log
    that show what failed.
    """

    name: str
    passed: int = 0
    failed: int = 0
    skipped: int = 0
    seconds: float = 0.0
    processor: float = 0.0  # seconds, with all child processes; 0 where the system does not say
    remarks: list[str] = field(default_factory=list)
    missing: str = ""
    tests: dict[str, str] = field(default_factory=dict)
    clues: list[str] = field(default_factory=list)

    @property
    def verdict(self) -> str:
        return "FAILED" if self.failed else "passed" if self.passed else "SKIPPED"


def file_name(name: str) -> str:
    """A stage's name as that of a file."""
    return re.sub(r"[^a-zA-Z0-9.]+", "-", name)


def skipped(name: str, why: str) -> Stage:
    """A stage that was not asked for."""
    return Stage(name, skipped=1, remarks=[why])


def untested(name: str, why: str) -> Stage:
    """A stage that this machine cannot run."""
    say(f"\n!!! {name} goes UNTESTED: {why}")
    return Stage(name, skipped=1, missing=why)


def broken(name: str, why: str) -> Stage:
    say(f"\n!!! {name}: {why}")
    return Stage(name, failed=1, remarks=[why])


def _reason(entry: dict) -> str:
    """Why a test was skipped, or is expected to fail, by its line in pytest's report."""
    given = entry["longrepr"]
    return (given[2] if isinstance(given, list) else entry.get("wasxfail", "")) or "no reason given"


def _read_report(stage: Stage, path: Path) -> str:
    """Add the counts and the distinct reasons for skips of one pytest run; returns what it did last.

    The report has a line for each phase of each test, written when the phase ends, so it also serves after a crash.
    """
    worst: dict[str, tuple[int, str]] = {}  # of a test: (0 passed, 1 skipped, 2 failed), the reason of a skip
    last = "before its first test"
    for line in path.read_text(encoding="utf-8").splitlines(keepends=True):
        entry = json.loads(line) if line.endswith("\n") else {}
        if "outcome" not in entry:
            continue
        name, rank = entry["nodeid"], ("passed", "skipped", "failed").index(entry["outcome"])
        when = entry.get("when")  # setup, call or teardown; None for the reading of a file
        if when:
            last = f"{'after' if when == 'teardown' else 'in'} {name}"
        if rank or when in ("call", "teardown"):
            text = _reason(entry).removeprefix("Skipped: ").splitlines()[0][:160] if rank == 1 else ""
            worst[name] = max(worst.get(name, (0, "")), (rank, text))
    for name, (rank, text) in worst.items():
        stage.passed += rank == 0
        stage.skipped += rank == 1
        stage.failed += rank == 2
        stage.tests[name] = text
    reasons = Counter(filter(None, stage.tests.values()))
    stage.remarks += [f"{reason} ({count})" if count > 1 else reason for reason, count in reasons.items()]
    return last


def _processor_seconds(process: subprocess.Popen) -> float | None:
    """What a process used that has ended, with the children it has waited for; None while it runs."""
    if not hasattr(os, "wait4"):  # Windows
        return None if process.poll() is None else 0.0
    ended, status, used = os.wait4(process.pid, os.WNOHANG)
    if not ended:
        return None
    process.returncode = os.waitstatus_to_exitcode(status)
    return used.ru_utime + used.ru_stime


def _run_watched(
    stage: Stage, command, environ, log: Path, report: Path | None = None, aside: bool = False
) -> int | None:
    """Run a command with its output in ``log``; its exit code, or None when it was stopped because it hung.

    The output is shown as it comes, or, of a command that runs ``aside`` others, at the end.  The stage's times are
    those of the command.
    """
    log.parent.mkdir(parents=True, exist_ok=True)
    started = time.monotonic()
    with open(log, "wb") as output, open(log, encoding="utf-8", errors="replace") as printed:
        process = subprocess.Popen(
            [str(part) for part in command], cwd=ROOT, env=environ, stdout=output, stderr=subprocess.STDOUT
        )
        if hasattr(os, "setpriority"):
            os.setpriority(os.PRIO_PROCESS, process.pid, NICENESS)
        try:
            seen, since = -1, time.monotonic()
            while (used := _processor_seconds(process)) is None:
                time.sleep(LOOK_SECONDS)
                size = sum(path.stat().st_size for path in (log, report) if path and path.exists())
                if size != seen:
                    seen, since = size, time.monotonic()
                elif time.monotonic() - since > SILENT_SECONDS:
                    return None
                if not aside:
                    print(printed.read(), end="", flush=True)
            stage.processor = used
        finally:
            process.kill()
            process.wait()
            stage.seconds = time.monotonic() - started
            say(printed.read())
    return process.returncode


def _clues(log: Path) -> list[str]:
    """The lines of a log that show what failed: the traceback that follows the last check, else the last lines."""
    lines = [line for line in log.read_text(encoding="utf-8", errors="replace").splitlines() if line.strip(" ^~")]
    first = max((n for n, line in enumerate(lines) if CHECK.fullmatch(line)), default=0)
    begun = [n for n, line in enumerate(lines) if n >= first and line.startswith(("Traceback (", "Fatal Python error"))]
    if not begun:
        return lines[-CLUES:]
    head, *after = lines[begun[-1] :]
    frames = list(takewhile(lambda line: line.startswith(" "), after))
    return [head, *frames[-CLUES // 2 :], *after[len(frames) :]][:CLUES]


def measured(name: str, command, environ, report: Path, aside: bool = False) -> Stage:
    """Run a command that ends with pytest's exit code and writes ``report`` (pytest-reportlog).

    ``aside``: beside other stages, so that its output is shown when it has ended.
    """
    stage = Stage(name)
    code = _run_watched(stage, command, environ, report.with_suffix(".txt"), report, aside)
    last = _read_report(stage, report) if report.is_file() else "before it reported"
    if code is None:
        stage.failed += 1
        stage.remarks.append(f"stopped {last}: nothing happened for {SILENT_SECONDS} s")
    elif code == 5:
        stage.skipped += 1
        stage.remarks.append("no tests were collected")
    elif code not in (0, 1) or (not stage.failed and (code == 1 or not report.is_file())):
        stage.failed += 1
        stage.remarks.append(f"it ended with code {code} {last}")
    stage.clues = _clues(report.with_suffix(".txt")) if stage.failed else []
    return stage


def counted(name: str, command, environ, log: Path) -> Stage:
    """Run a script that prints a line 'N passed, N failed, N skipped' and ends with code 0 when all is well."""
    stage = Stage(name)
    code = _run_watched(stage, command, environ, log, aside=True)
    printed = log.read_text(encoding="utf-8", errors="replace")
    counts = re.findall(r"^(\d+) passed, (\d+) failed, (\d+) skipped$", printed, re.MULTILINE)
    if counts:
        stage.passed, stage.failed, stage.skipped = map(int, counts[-1])
    if code is None:
        stage.failed += 1
        last = (printed.strip().splitlines() or ["nothing"])[-1]
        stage.remarks.append(f"stopped: nothing happened for {SILENT_SECONDS} s after it printed {last!r}")
    elif (code != 0 or not counts) and not stage.failed:
        stage.failed += 1
        stage.remarks.append(f"it ended with code {code}" + ("" if counts else " and without its counts"))
    stage.clues = _clues(log) if stage.failed else []
    return stage


def _never_run(stages: list[Stage]) -> Counter:
    """How many tests no stage ran for want of a package, by reason."""
    ran = {name for stage in stages for name, reason in stage.tests.items() if not reason}
    ran |= {name.split("::")[0] for name in ran}  # a whole file may be skipped elsewhere
    reasons = {name: reason for stage in stages for name, reason in stage.tests.items() if name not in ran}
    return Counter(filter(_NO_PACKAGE.search, reasons.values()))


def summary(stages: list[Stage]) -> int:
    """Print the table of stages, what failed, the plain line of totals and, last, what this machine could not test.

    The exit code is 0 when nothing failed and, in CI, nothing was left out.
    """
    passed, failed, skipped = (sum(getattr(s, key) for s in stages) for key in ("passed", "failed", "skipped"))
    say("\n" + "stage".ljust(31) + "result    passed  failed  skipped   seconds  of a processor")
    for stage in stages:
        counts = f"{stage.passed:6d}  {stage.failed:6d}  {stage.skipped:7d}"
        say(f"{stage.name:<31}{stage.verdict:<8}  {counts}  {stage.seconds:8.1f}  {stage.processor:14.1f}")
        for remark in stage.remarks:
            say(f"    {remark}")
    for stage in (stage for stage in stages if stage.failed):
        say("\n" + "\n    ".join((f"FAILED: {stage.name}", *(line[:LINE] for line in stage.clues or stage.remarks))))
    lacking = [f"{stage.name} ({stage.missing})" for stage in stages if stage.missing]
    lacking += [f"{count} tests ({reason})" for reason, count in _never_run(stages).items()]
    say()
    say(f"{passed} passed, {failed} failed, {skipped} skipped")
    if lacking:
        say(f"NOT TESTED on this machine: {'; '.join(lacking)}.")
    return 1 if failed or not passed or (lacking and os.environ.get("CI")) else 0
