"""Locks between processes, on a file that stands for what only one of them may do."""

import errno
import os
import sys
from contextlib import contextmanager, suppress
from pathlib import Path

WITHOUT_LOCKS = {errno.ENOLCK, errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP}  # of some network disks


@contextmanager
def only_one(path: Path):
    """Hold the lock of a file, which is made for it and deleted afterward; yields whether it was free.

    The lock is the system's, on an open file, and ends with the process that holds it. A file that a killed process
    left is a free lock. On a disk without locks every lock is free.
    """
    while True:
        with open(path, "ab") as file:
            free = _is_taken(file)
            if free and not _is_at(file, path):  # its last holder deleted it after it was opened here
                continue
            try:
                yield free
            finally:
                if free:
                    if sys.platform == "win32":  # which deletes no open file, and so none that another holds by then
                        file.close()
                    with suppress(PermissionError):  # what is left behind is a free lock
                        path.unlink(missing_ok=True)
            return


def _is_taken(file) -> bool:
    """Take the lock of an open file; whether it was free."""
    try:
        if sys.platform == "win32":
            import msvcrt

            file.seek(0)
            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except (BlockingIOError, PermissionError):
        return False
    except OSError as problem:
        if problem.errno not in WITHOUT_LOCKS:
            raise
    return True


def _is_at(file, path: Path) -> bool:
    """Whether an open file is the one that ``path`` names now."""
    try:
        return os.path.samestat(os.fstat(file.fileno()), os.stat(path))
    except FileNotFoundError:
        return False
