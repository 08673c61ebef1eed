"""What is kept between frames, in one place: results of stages, keyed by the content they were made from.

A key names everything a result depends on, so nothing kept can go stale: not by undo, not by loading another
file, not by a job that was cancelled half-way (a result enters only when it is whole).
"""

from __future__ import annotations

from collections import OrderedDict

MOST_BYTES = 1 << 30


class Kept:
    """A store of stage results, the least recently used leaving first when ``most_bytes`` are exceeded.

    ``made`` counts how often each stage really ran, so that tests can tell work from reuse.
    """

    def __init__(self, most_bytes: int = MOST_BYTES):
        self.most_bytes = most_bytes
        self.made: dict[str, int] = {}
        self._results: OrderedDict = OrderedDict()
        self._bytes = 0

    def get(self, stage: str, key, make, size):
        """The result of ``stage`` for ``key``: the kept one, or ``make()``, whose bytes ``size(result)`` tells."""
        place = (stage, key)
        if place in self._results:
            self._results.move_to_end(place)
            return self._results[place][0]
        result = make()
        self.made[stage] = self.made.get(stage, 0) + 1
        self._results[place] = (result, size(result))
        self._bytes += self._results[place][1]
        while self._bytes > self.most_bytes and len(self._results) > 1:
            _, (_, freed) = self._results.popitem(last=False)
            self._bytes -= freed
        return result

    def has(self, stage: str, key) -> bool:
        return (stage, key) in self._results

    def clear(self) -> None:
        self._results.clear()
        self._bytes = 0
