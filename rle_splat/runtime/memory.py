"""How much memory there is, asked of the system before it is spent."""

import os
import sys
from pathlib import Path

from ..scene import RleSplatError

try:
    import resource
except ImportError:  # Windows has no such limits
    resource = None

UNLIMITED = 1 << 62
MEMINFO = Path("/proc/meminfo")  # Linux
GROUP_OF_PROCESS = Path("/proc/self/cgroup")
GROUPS = Path("/sys/fs/cgroup")
ADDRESS_SPACE_USED = Path("/proc/self/statm")
STATUS = Path("/proc/self/status")
COARSER = "write a coarser file with rle-splat convert --level 1"
REMEDY = f"close other programs, or {COARSER}"  # where voxels are in memory
READING_REMEDY = f"{REMEDY} on a computer with more memory"  # where convert would need as much


class _Limit:
    """``most``: set by ``limit_to``; ``of_process``: by ``limit_process_to``."""

    most = of_process = UNLIMITED


def limit_to(most: int | None) -> None:
    """Let ``available_bytes`` be at most so many bytes; None lifts the limit."""
    _Limit.most = UNLIMITED if most is None else most


def limit_process_to(most: int | None) -> None:
    """Let this process take at most so many bytes in all, pages of mapped files aside; None lifts the limit.

    What it has taken already counts on Linux; elsewhere the limit is for what is still to be taken.
    """
    _Limit.of_process = UNLIMITED if most is None else most


def total_bytes() -> int:
    """Memory of the machine; ``UNLIMITED`` where the system does not say."""
    if sys.platform == "win32":
        return _windows_memory()[0]
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (OSError, ValueError):
        return UNLIMITED


def available_bytes() -> int:
    """Memory that can still be taken without swapping: the least that machine, container and limits leave.

    Memory the system holds copies of files in counts as free, for it gives that back.
    """
    own = _Limit.of_process if _Limit.of_process == UNLIMITED else _Limit.of_process - _anonymous_bytes()
    return max(min(_machine_free(), _group_free(), _address_space_free(), _Limit.most, own), 0)


def refuse_beyond(needed: int, what: str, remedy: str = REMEDY) -> None:
    """RleSplatError when ``needed`` bytes for ``what`` are more than there is; ``remedy``: what would help."""
    free = available_bytes()
    if needed > free:
        raise RleSplatError(f"{what} {bytes_text(needed)} of memory and {bytes_text(free)} are free; {remedy}.")


def bytes_text(count: float) -> str:
    """A byte count as people read it, in powers of 1024."""
    for unit in ("bytes", "KiB", "MiB", "GiB"):
        if count < 1024 or unit == "GiB":
            break
        count /= 1024
    return f"{count:.0f} {unit}" if unit == "bytes" else f"{count:.1f} {unit}"


def _machine_free() -> int:
    if sys.platform == "win32":
        return _windows_memory()[1]
    for line in _lines(MEMINFO):
        if line.startswith("MemAvailable:"):
            return 1024 * int(line.split()[1])
    return total_bytes()  # macOS compresses and pages what others hold, and tells no number


def _group_free() -> int:
    """What the control groups of a container leave, the outer ones too (Linux, version 1 and 2)."""
    free = UNLIMITED
    for line in _lines(GROUP_OF_PROCESS):
        _, controllers, path = line.split(":", 2)
        if controllers not in ("", "memory"):
            continue
        first = controllers == "memory"
        names = ("memory.limit_in_bytes", "memory.usage_in_bytes") if first else ("memory.max", "memory.current")
        root = GROUPS / "memory" if first else GROUPS
        folder = root / path.strip("/")
        for group in (folder, *folder.parents):
            limit = _number(group / names[0])
            is_less = limit is not None and limit < total_bytes()  # else the machine has no more
            used = _number(group / names[1]) if is_less else None
            if used is not None:
                free = min(free, limit - used + _file_cache(group))
            if group == root:
                break
    return free


def _file_cache(group: Path) -> int:
    """Bytes of files that a control group holds and would give back."""
    kept = [line.split() for line in _lines(group / "memory.stat")]
    totals = {name: int(number) for name, number in (pair for pair in kept if len(pair) == 2)}
    prefix = "total_" if "total_inactive_file" in totals else ""
    return totals.get(f"{prefix}inactive_file", 0) + totals.get(f"{prefix}active_file", 0)


def _address_space_free() -> int:
    """What the process's own limit (ulimit -v) leaves."""
    if resource is None:
        return UNLIMITED
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    if limit == resource.RLIM_INFINITY:
        return UNLIMITED
    pages = next(iter(_lines(ADDRESS_SPACE_USED)), "0").split()[0]
    return limit - int(pages) * os.sysconf("SC_PAGE_SIZE")


def _anonymous_bytes() -> int:
    """Memory of this process that is no copy of a file; 0 where the system does not say."""
    for line in _lines(STATUS):
        if line.startswith("RssAnon:"):
            return 1024 * int(line.split()[1])
    return 0


def _lines(path: Path) -> list[str]:
    try:
        return path.read_text(encoding="ascii").splitlines()
    except (OSError, UnicodeDecodeError):
        return []


def _number(path: Path) -> int | None:
    """The whole number a file holds; None when there is none, as for "max"."""
    lines = _lines(path)
    return int(lines[0]) if lines and lines[0].isdigit() else None


def _windows_memory() -> tuple[int, int]:
    """(total, available) bytes."""
    import ctypes

    class Status(ctypes.Structure):
        """MEMORYSTATUSEX of the Windows API."""

        _fields_ = [
            ("length", ctypes.c_ulong), ("load", ctypes.c_ulong),
            *((name, ctypes.c_ulonglong) for name in (
                "total", "available", "total_page", "available_page", "total_virtual", "available_virtual", "extended"
            )),
        ]  # fmt: skip

    status = Status(length=ctypes.sizeof(Status))
    if not ctypes.windll.kernel32.GlobalMemoryStatusEx(ctypes.byref(status)):
        return UNLIMITED, UNLIMITED
    return status.total, status.available
