"""The stage cache: results of stages kept between frames, keyed by the content that they were made from.

A key holds everything that a result depends on, so no result can go stale, not by undo and not by loading another
file.  A job reads the cache and adds its own results only when all of its work is done.  A job that was cancelled or
failed half-way therefore leaves the cache as it was.  Jobs of several threads may share a cache, because Blender
renders beside its window.  So a job never relies on a result to be still there.
"""

from __future__ import annotations

import math
import time

from ..runtime.buffer_pool import forget
from ..runtime.memory import available_bytes, total_bytes

LEAST_BYTES = 1 << 30  # kept on any machine
SHARE = 0.25  # of a larger machine's memory
FRESH = 1.0  # seconds for which free memory, once asked for, is taken for granted where far less is needed
FEW = 1.0 / 16.0  # of the free memory is far less
# How many results of a stage are kept while a light, a camera or a transfer function is dragged about.  (Memory of
# those that leave is used again, see ``runtime.buffer_pool``.)
MOST_RESULTS = {
    "visible": 6, "relevant": 6, "properties": 6, "surfaces": 2, "normals": 6, "codes": 6, "runs": 6, "records": 6,
    "scalars": 6, "values": 6, "bricks": 6, "table": 6, "gradients": 6, "thinned": 6, "revealed": 2, "labels": 2,
    "factor": 6, "extinction": 2, "pooled": 2, "shadows": 12, "mesh shadows": 12, "ambient occlusion": 6,
    "roughness": 12,
}  # fmt: skip


class StageCache:
    """Results of stages, reused between pictures; the least recently used are dropped first.

    Pass one cache to ``render`` for all pictures of a volume.  The key of a result is all that it was made from, so a
    picture computes only what changed, and is bit-identical to one without the cache.

    Parameters
    ----------
    most_bytes : int, optional
        Most bytes to store; 0 stores nothing.  Left out, a quarter of the machine's memory, one GiB at least.

    Attributes
    ----------
    made : dict
        How often each stage was computed instead of reused, by its name, such as ``{"shadows": 2}``.
    """

    def __init__(self, most_bytes: int | None = None):
        self.most_bytes = max(LEAST_BYTES, int(SHARE * total_bytes())) if most_bytes is None else most_bytes
        self.made: dict[str, int] = {}
        self._stale, self._free = -math.inf, 0  # until when a count of free bytes holds, and that count
        self._results: dict = {}  # the least recently used first; looked through in copies

    @property
    def keeps(self) -> bool:
        """Whether results are stored at all; a cache without room needs no keys."""
        return self.most_bytes > 0

    @property
    def nbytes(self) -> int:
        """Bytes of all stored results."""
        return sum(size for _, size, _ in self._results.copy().values())

    @property
    def contents(self) -> tuple:
        """(stage, key) of every result, the least recently used first."""
        return tuple(self._results.copy())

    def job(self, frame=None) -> Job:
        """A new job, which reads this cache and stores its own results in it when all of its work is done.

        ``frame``: key of a time point, whose results are counted by themselves, so that a loop makes each frame
        once, as far as there is memory.
        """
        return Job(self, frame)

    def has(self, stage: str, key) -> bool:
        """Whether a result of a stage is stored under a key."""
        return (stage, key) in self._results

    def clear(self) -> None:
        """Drop all results and free their memory."""
        self._results.clear()
        forget()

    def make_room(self, needed: int) -> None:
        """Drop everything where the machine has fewer than ``needed`` bytes free: a picture comes first."""
        if needed > available_bytes():
            self.clear()

    def has_plenty(self, needed: int) -> bool:
        """Whether ``needed`` bytes are so few that the free memory need not be asked for again.

        The system was asked at most FRESH seconds ago, and had many times as many.  (Asking it takes 0.4 ms in a
        container, a tenth of a quick frame.)
        """
        now = time.monotonic()
        if now >= self._stale:
            self._stale, self._free = now + FRESH, available_bytes()
        return needed < FEW * self._free

    def _add(self, entry, result, size: int, frame) -> None:
        was_held = self._results.pop(entry, None) is not None
        self._results[entry] = (result, size, frame)
        if was_held:
            return
        alike = [other for other, (*_, own) in self._results.copy().items() if (other[0], own) == (entry[0], frame)]
        for oldest in alike[: -MOST_RESULTS.get(entry[0], len(alike))]:
            self._drop(oldest)

    def _trim(self) -> None:
        """Drop results, the least recently used first, while there are too many bytes; the last one stays."""
        for oldest in self.contents[:-1]:
            if self.nbytes <= self.most_bytes:
                break
            self._drop(oldest)

    def _drop(self, entry) -> None:
        self._results.pop(entry, None)


class Job:
    """The stage results that one picture or one file uses: those of the cache, and those that it makes itself."""

    def __init__(self, cache: StageCache, frame):
        self.cache, self._frame = cache, frame
        self._used: dict = {}

    def has(self, stage: str, key) -> bool:
        """Whether there is a result, which then stays until the job is done."""
        return self._find((stage, key))

    def get(self, stage: str, key, make, size=None):
        """The result of a stage for a key: the cached one, or ``make()``.

        ``size(result)``: its bytes; left out, its own ``nbytes``.
        """
        entry = (stage, key)
        if not self._find(entry):
            self._note_made(entry, make(), size)
        return self._used[entry][0]

    def steps(self, stage: str, key, make_steps, size=None):
        """Generator form of ``get``: ``make_steps()`` is a generator of fractions done that returns the result."""
        entry = (stage, key)
        if not self._find(entry):
            self._note_made(entry, (yield from make_steps()), size)
        return self._used[entry][0]

    def latest(self, stage: str, serves) -> object:
        """The key of the latest cached result of a stage for which ``serves(key, result)`` holds; None for none.

        The result then stays until the job is done.
        """
        for entry, held in reversed(self.cache._results.copy().items()):
            if entry[0] == stage and serves(entry[1], held[0]):
                self._used[entry] = held
                return entry[1]
        return None

    def keep(self) -> None:
        """Add everything that the job used to the cache; call it when the job is done."""
        if self.cache.keeps:
            for entry, held in self._used.items():
                self.cache._add(entry, *held)
            self.cache._trim()

    def _find(self, entry) -> bool:
        held = self._used.pop(entry, None) or self.cache._results.get(entry)
        if held is not None:
            self._used[entry] = held  # the last of them now
        return held is not None

    def _note_made(self, entry, result, size) -> None:
        self.cache.made[entry[0]] = self.cache.made.get(entry[0], 0) + 1
        self._used[entry] = (result, result.nbytes if size is None else size(result), self._frame)
