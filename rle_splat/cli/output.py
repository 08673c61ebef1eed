"""Output files that are written completely or not at all."""

from __future__ import annotations

import os
from contextlib import contextmanager
from pathlib import Path

from ..scene import RleSplatError


def _part(path: Path) -> Path:
    """The temporary file beside ``path``: hidden, with the process id in its name."""
    return path.with_name(f".{path.name}.{os.getpid()}.part")


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
    seen = set()
    for path in map(Path, paths):
        folder = path.parent
        if not folder.is_dir():
            raise RleSplatError(f"Cannot write {path}: the folder {folder} does not exist; make it first.")
        if path.is_dir():
            raise RleSplatError(f"Cannot write {path}: it is a folder; give a file name.")
        if path.exists() and not path.is_file():
            raise RleSplatError(f"Cannot write {path}: it is not an ordinary file; give another name.")
        resolved = path.resolve()
        if resolved in seen:
            raise RleSplatError(f"{path} is named twice as an output; give each output its own name.")
        seen.add(resolved)
        if any(Path(source).resolve() == resolved for source in inputs if source is not None):
            raise RleSplatError(f"{path} is read by this command and cannot be its output; give another name.")
        trial = _part(path)
        try:
            trial.touch()
            trial.unlink()
        except OSError as problem:
            raise RleSplatError(f"Cannot write {path}: {problem.strerror}; choose another place.") from None


@contextmanager
def whole_files(paths):
    """Context manager: temporary files that are renamed to their targets on success and deleted on failure.

    All are written before the first is renamed, so an interruption leaves no new or damaged file.

    Parameters
    ----------
    paths : iterable of path-like
        The target files.

    Yields
    ------
    list of Path
        A temporary path for each target.
    """
    targets = [Path(path) for path in paths]
    parts = [_part(target) for target in targets]
    try:
        yield parts
        for part, target in zip(parts, targets):
            os.replace(part, target)
    finally:
        for part in parts:
            part.unlink(missing_ok=True)
