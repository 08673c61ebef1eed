"""Files that are written completely or not at all."""

import errno
import os
import time
from contextlib import contextmanager
from pathlib import Path

from ..scene import RleSplatError

PAUSES = 0.1, 0.4  # seconds before a file or folder that another program holds is renamed again
PART = ".part-"  # between the process id and the name of a file that is not complete
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


def part_of(path: Path) -> Path:
    """The temporary file beside ``path``: hidden, with the process id in its name and the same suffixes."""
    return path.with_name(f".{os.getpid()}{PART}{path.name}")


@contextmanager
def writing(path):
    """Context manager: a failure of the system to write ``path`` becomes a RleSplatError."""
    try:
        yield
    except OSError as problem:
        why = problem.strerror or "not all of it could be written"  # packages do not always say what was wrong
        raise RleSplatError(f"Cannot write {path}: {why}; choose another place, or make room there.") from None


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

    Raises
    ------
    OSError
        Of a full disk and of a temporary file, with the name of the target.
    """
    targets = [Path(path) for path in paths]
    parts = [part_of(target) for target in targets]
    try:
        yield parts
        for part, target in zip(parts, targets):
            rename(part, target)
    except OSError as problem:
        of_parts = {str(part): str(target) for part, target in zip(parts, targets)}
        written = [target for part, target in of_parts.items() if os.path.exists(part)]
        if problem.filename is not None:
            written = [of_parts[str(problem.filename)]] if str(problem.filename) in of_parts else []
        elif problem.errno not in FULL:
            written = []
        if not written:
            raise
        raise OSError(problem.errno, problem.strerror, ", ".join(written)) from None
    finally:
        for part in parts:
            part.unlink(missing_ok=True)


def rename(source: Path, target: Path) -> None:
    """Rename a file or folder, again where Windows refuses: a virus scanner opens new files for a moment."""
    for pause in PAUSES:
        try:
            return os.replace(source, target)
        except PermissionError:
            time.sleep(pause)
    return os.replace(source, target)


@contextmanager
def whole_file(path):
    """Context manager: the temporary file of one target, as of ``whole_files``; a failure is a RleSplatError."""
    with writing(path), whole_files([path]) as parts:
        yield parts[0]
