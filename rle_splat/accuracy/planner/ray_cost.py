"""Error and time of single rays, as functions of their number and of the slabs that a voxel's depth is cut into."""

from __future__ import annotations

from dataclasses import dataclass, replace

MOST_SLABS = 64
SLABS = tuple(2**n for n in range(1, 7))  # to choose from
UNSEEN_FACTOR = 2.0  # rays that were not measured may err this many times as much as those that were
RAY_ORDER = 2.0  # the error falls with this power of the number of slabs


@dataclass(frozen=True)
class RayCost:
    """What single rays err and take, from rays that were traced twice.

    Attributes
    ----------
    few : int
        Slabs of the coarser of the two; the other had twice as many.
    apart : float
        The largest difference between both, in levels.
    microseconds : tuple of float
        Of a ray without slabs, and of each slab.
    correction : float
        The factor by which rays were found to err more than expected.
    """

    few: int
    apart: float
    microseconds: tuple[float, float]
    correction: float = 1.0

    @classmethod
    def of(cls, few: int, apart: float, spent, rays: int) -> RayCost:
        """Make one from ``spent``: milliseconds of ``rays`` rays with ``few`` slabs, and with twice as many."""
        first, second = (1e3 * ms / max(rays, 1) for ms in spent)
        each = max(second - first, 0.05 * first) / few
        return cls(few, apart, (max(first - few * each, 0.1 * first), each))

    def found(self, measured: float, slabs: int) -> RayCost:
        """Correct the cost after rays of ``slabs`` slabs were found to err ``measured`` levels."""
        return replace(self, correction=self.correction * max(measured / max(self.error(slabs), 1e-9), 2.0))

    def error(self, slabs: int) -> float:
        """The largest error, in levels, that is expected of rays of ``slabs`` slabs."""
        share = 2.0**RAY_ORDER / (2.0**RAY_ORDER - 1.0)
        return self.correction * UNSEEN_FACTOR * share * self.apart * (self.few / slabs) ** RAY_ORDER

    def milliseconds(self, rays: int, slabs: int) -> float:
        """The expected time of ``rays`` rays of ``slabs`` slabs."""
        return 1e-3 * rays * (self.microseconds[0] + slabs * self.microseconds[1])

    def slabs_for(self, allowed: float) -> int:
        """The fewest slabs whose expected error is at most ``allowed`` levels; MOST_SLABS where none are enough."""
        return next((slabs for slabs in SLABS if self.error(slabs) <= allowed), MOST_SLABS)
