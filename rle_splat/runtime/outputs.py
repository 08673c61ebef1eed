"""Output files: checked before any work is done, and reports as strict JSON."""

import json
import os
from contextlib import ExitStack
from pathlib import Path

from ..scene import RleSplatError
from ..scene.plain import plain
from .whole_files import part_of, writing


def check_outputs(paths, inputs=()) -> None:
    """Check the outputs of a command before any work is done.

    Parameters
    ----------
    paths : iterable of path-like
        The files to write.
    inputs : iterable of path-like or None
        The files that the command reads.

    Raises
    ------
    RleSplatError
        If an output cannot be written, is named twice, or would overwrite an input.
    """
    seen, trials = set(), []
    with ExitStack() as stack:
        for path in map(Path, paths):
            _check_place(path)
            resolved = os.path.realpath(path)  # Path.resolve raises where links form a loop
            if path.exists() and any(path.samefile(source) for source in inputs if source and os.path.exists(source)):
                raise RleSplatError(f"{path} is read by this command and cannot be its output; give another name.")
            trial = part_of(path)
            with writing(path):
                trial.touch()
            stack.callback(trial.unlink, missing_ok=True)
            if resolved in seen or any(map(trial.samefile, trials)):  # the latter on disks that ignore case
                raise RleSplatError(f"{path} is named twice as an output; give each output its own name.")
            seen.add(resolved)
            trials.append(trial)


def _check_place(path: Path) -> None:
    """RleSplatError if no file can be at a path."""
    if not path.parent.is_dir():
        raise RleSplatError(f"Cannot write {path}: the folder {path.parent} does not exist; make it first.")
    if path.is_dir():
        raise RleSplatError(f"Cannot write {path}: it is a folder; give a file name.")
    if path.exists() and not path.is_file():
        raise RleSplatError(f"Cannot write {path}: it is not an ordinary file; give another name.")


def write_report(path, report: dict) -> None:
    """Write a report to a file as indented UTF-8 JSON."""
    Path(path).write_text(json.dumps(plain(report), indent=2, allow_nan=False) + "\n", encoding="utf-8")
