"""One stage of the tests: how it is run, how long it may take, what it says, and the table at the end."""

from __future__ import annotations

import re
import subprocess
import time
import xml.etree.ElementTree as ElementTree
from contextlib import nullcontext
from dataclasses import dataclass, field
from pathlib import Path

from .places import ROOT, say


@dataclass
class Stage:
    """The outcome of one stage; ``remarks`` say why something was skipped or what broke."""

    name: str
    passed: int = 0
    failed: int = 0
    skipped: int = 0
    seconds: float = 0.0
    remarks: list[str] = field(default_factory=list)

    @property
    def verdict(self) -> str:
        return "FAILED" if self.failed else "passed" if self.passed else "SKIPPED"


def skipped(name: str, why: str) -> Stage:
    say(f"\n!!! {name} goes UNTESTED: {why}")
    return Stage(name, skipped=1, remarks=[why])


def broken(name: str, why: str) -> Stage:
    say(f"\n!!! {name}: {why}")
    return Stage(name, failed=1, remarks=[why])


def _read_junit(stage: Stage, path: Path) -> None:
    """Add the counts and the distinct reasons for skips of one pytest run."""
    for case in ElementTree.parse(path).getroot().iter("testcase"):
        outcomes = {child.tag: child for child in case if child.tag in ("failure", "error", "skipped")}
        if "failure" in outcomes or "error" in outcomes:
            stage.failed += 1
        elif "skipped" in outcomes:
            stage.skipped += 1
            reason = (outcomes["skipped"].get("message") or "no reason given").splitlines()[0][:160]
            if reason not in stage.remarks:
                stage.remarks.append(reason)
        else:
            stage.passed += 1


def _run_limited(command, seconds: float, environ, log: Path | None) -> int | None:
    """Run a command with its output shown, or in ``log``; its exit code, or None when the time ran out."""
    with open(log, "wb") if log else nullcontext() as output:
        try:
            return subprocess.run(
                [str(part) for part in command], cwd=ROOT, env=environ, timeout=seconds, stdout=output,
                stderr=subprocess.STDOUT if log else None,
            ).returncode  # fmt: skip
        except subprocess.TimeoutExpired:
            return None


def measured(name: str, command, seconds: float, environ, report: Path, log: Path | None = None) -> Stage:
    """Run a command that ends with pytest's exit code and writes ``report`` (JUnit's XML).

    ``log``: a file for its output, of a stage that runs beside another; it is shown when the stage has ended.
    """
    stage = Stage(name)
    started = time.monotonic()
    code = _run_limited(command, seconds, environ, log)
    if log:
        say(f"\n=== {name}\n{log.read_text(encoding='utf-8', errors='replace')}")
    stage.seconds = time.monotonic() - started
    if report.is_file():
        _read_junit(stage, report)
    if code is None:
        stage.failed += 1
        stage.remarks.append(f"stopped after {seconds:.0f} s: it hung")
    elif code == 5:
        stage.skipped += 1
        stage.remarks.append("no tests were collected")
    elif (code != 0 or not report.is_file()) and not stage.failed:
        stage.failed += 1
        stage.remarks.append(f"it ended with code {code}" + ("" if report.is_file() else " before it reported"))
    return stage


def counted(name: str, command, seconds: float, environ) -> Stage:
    """Run a script that prints a line 'N passed, N failed, N skipped' and ends with code 0 when all is well."""
    stage = Stage(name)
    started = time.monotonic()
    try:
        done = subprocess.run(
            [str(part) for part in command], cwd=ROOT, env=environ, timeout=seconds,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace",
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return broken(name, f"stopped after {seconds:.0f} s: it hung")
    stage.seconds = time.monotonic() - started
    say(done.stdout)
    counts = re.findall(r"^(\d+) passed, (\d+) failed, (\d+) skipped$", done.stdout, re.MULTILINE)
    if counts:
        stage.passed, stage.failed, stage.skipped = map(int, counts[-1])
    if (done.returncode != 0 or not counts) and not stage.failed:
        stage.failed += 1
        stage.remarks.append(f"it ended with code {done.returncode}" + ("" if counts else " and without its counts"))
    return stage


def summary(stages: list[Stage]) -> int:
    """Print the table of stages and the plain line of totals, last; returns the exit code."""
    passed, failed, skipped = (sum(getattr(s, key) for s in stages) for key in ("passed", "failed", "skipped"))
    say("\n" + "stage".ljust(26) + "result    passed  failed  skipped   seconds")
    for stage in stages:
        counts = f"{stage.passed:6d}  {stage.failed:6d}  {stage.skipped:7d}  {stage.seconds:8.1f}"
        say(f"{stage.name:<26}{stage.verdict:<8}  {counts}")
        for remark in stage.remarks:
            say(f"    {remark}")
    say()
    say(f"{passed} passed, {failed} failed, {skipped} skipped")
    return 1 if failed or not passed else 0
