"""What is kept between frames, in one place: results of stages, keyed by the content they were made from.

A key names everything a result depends on, so nothing kept can go stale: not by undo, not by loading another
file.  A job sees what is kept, and hands over what it made only when all of it is done, so a job that was cancelled
or failed half-way leaves everything as it was.  Jobs of several threads may share a store (Blender renders beside its
window): nothing is relied on to be still there, and nothing is counted but what is.
"""

from __future__ import annotations

from ..runtime.buffer_pool import forget
from ..runtime.memory import available_bytes, total_bytes

LEAST_BYTES = 1 << 30  # kept on any machine
SHARE = 0.25  # of a larger machine's memory
# Stages whose results replace one another as a light, a camera or a transfer function is dragged about: how many are
# worth their memory.  (What leaves makes room for what comes, see ``reused``.)
MOST_RESULTS = {
    "visible": 6, "relevant": 6, "looks": 6, "normals": 6, "light": 6, "runs": 6, "records": 6, "scalars": 6,
    "lights": 6, "bricks": 6, "table": 6, "gradients": 6, "thinned": 6, "pyramid": 2, "nodes": 2, "node records": 6,
    "shadows": 12, "ambient occlusion": 6,
}  # fmt: skip


class StageCache:
    """A store of stage results, the least recently used leaving first when ``most_bytes`` are exceeded.

    Left out, ``most_bytes`` is a quarter of the machine's memory, one GiB at least.
    ``made`` counts how often each stage really ran, so that tests can tell work from reuse.
    """

    def __init__(self, most_bytes: int | None = None):
        self.most_bytes = max(LEAST_BYTES, int(SHARE * total_bytes())) if most_bytes is None else most_bytes
        self.made: dict[str, int] = {}
        self._results: dict = {}  # the least recently used first; looked through in copies

    @property
    def keeps(self) -> bool:
        """Whether there is any use in keys: a store without room forgets at once."""
        return self.most_bytes > 0

    @property
    def nbytes(self) -> int:
        return sum(size for _, size in self._results.copy().values())

    @property
    def contents(self) -> tuple:
        """(stage, key) of every result, the least recently used first."""
        return tuple(self._results.copy())

    def job(self) -> Job:
        """A job's view of the store; see the module."""
        return Job(self)

    def has(self, stage: str, key) -> bool:
        return (stage, key) in self._results

    def clear(self) -> None:
        self._results.clear()
        forget()

    def make_room(self, needed: int) -> None:
        """Forget everything when ``needed`` bytes are more than the machine has free: a picture comes first."""
        if needed > available_bytes():
            self.clear()

    def _add(self, place, result, size: int) -> None:
        self._drop(place)
        self._results[place] = (result, size)
        alike = [other for other in self.contents if other[0] == place[0]]
        for oldest in alike[: -MOST_RESULTS.get(place[0], len(alike))]:
            self._drop(oldest)
        for oldest in self.contents[:-1]:
            if self.nbytes <= self.most_bytes:
                break
            self._drop(oldest)

    def _drop(self, place) -> None:
        self._results.pop(place, None)


class Job:
    """One picture's or one file's work: results of stages by content, those kept and those made by itself."""

    def __init__(self, cache: StageCache):
        self.cache = cache
        self._used: dict = {}

    def has(self, stage: str, key) -> bool:
        """Whether a result is at hand, kept or made by this job, and will be until the job is done."""
        return self._find((stage, key))

    def get(self, stage: str, key, make, size=None):
        """The result of ``stage`` for ``key``: the kept one, or ``make()``.

        ``size(result)`` tells its bytes; without it, its own ``nbytes`` do.
        """
        place = (stage, key)
        if not self._find(place):
            self._made(place, make(), size)
        return self._used[place][0]

    def steps(self, stage: str, key, make_steps, size=None):
        """Generator form of ``get``: ``make_steps()`` is a generator of fractions done that returns the result."""
        place = (stage, key)
        if not self._find(place):
            self._made(place, (yield from make_steps()), size)
        return self._used[place][0]

    def latest(self, stage: str, serves) -> object:
        """The key of the latest kept result of ``stage`` for which ``serves(key, result)``, which is at hand from now
        on; None if there is none."""
        for place, held in reversed(self.cache._results.copy().items()):
            if place[0] == stage and serves(place[1], held[0]):
                self._used[place] = held
                return place[1]
        return None

    def keep(self) -> None:
        """Hand over to the store everything that the job used; call it when the job is done."""
        if self.cache.keeps:
            for place, (result, size) in self._used.items():
                self.cache._add(place, result, size)

    def _find(self, place) -> bool:
        held = self._used.pop(place, None) or self.cache._results.get(place)
        if held is not None:
            self._used[place] = held  # the last of them now
        return held is not None

    def _made(self, place, result, size) -> None:
        self.cache.made[place[0]] = self.cache.made.get(place[0], 0) + 1
        self._used[place] = (result, result.nbytes if size is None else size(result))
