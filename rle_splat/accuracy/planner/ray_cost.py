"""Error and time of single rays, as functions of their number and of the slabs that a voxel's depth is cut into."""

from __future__ import annotations

from dataclasses import dataclass, replace

MOST_SLABS = 64
SLABS = tuple(2**n for n in range(1, 7))  # to choose from
FEW_SLABS = 4  # of rays by which others are foreseen; they are traced with twice as many, too
UNSEEN_FACTOR = 2.0  # rays that were not measured may err this many times as much as those that were
RAY_ORDER = 2.0  # the error falls with this power of the number of slabs


@dataclass(frozen=True)
class RayCost:
    """What single rays err and take, from rays that were traced twice.

    Attributes
    ----------
    apart : float
        The largest difference between rays of FEW_SLABS slabs and of twice as many, in levels.
    counted_us : tuple of float
        Microseconds of a ray without slabs, and of each slab, by their work and the machine's profile: plans are chosen
        by these.
    measured_us : tuple of float
        The same scaled by the times of this run, in which the scene's own caches and tables count, for what users
        see.
    correction : float
        The factor by which rays were found to err more than expected.
    """

    apart: float
    counted_us: tuple[float, float]
    measured_us: tuple[float, float]
    correction: float = 1.0

    def found(self, measured: float, slabs: int) -> RayCost:
        """Correct the cost after rays of ``slabs`` slabs were found to err ``measured`` levels."""
        return replace(self, correction=self.correction * max(measured / max(self.error(slabs), 1e-9), 2.0))

    def error(self, slabs: int) -> float:
        """The largest error, in levels, that is expected of rays of ``slabs`` slabs."""
        share = 2.0**RAY_ORDER / (2.0**RAY_ORDER - 1.0)
        return self.correction * UNSEEN_FACTOR * share * self.apart * (FEW_SLABS / slabs) ** RAY_ORDER

    def milliseconds(self, rays: int, slabs: int) -> float:
        """The time of ``rays`` rays of ``slabs`` slabs by which plans are chosen."""
        return _milliseconds(self.counted_us, rays, slabs)

    def expected_ms(self, rays: int, slabs: int) -> float:
        """The time that they are expected to take in this run."""
        return _milliseconds(self.measured_us, rays, slabs)

    def slabs_for(self, allowed: float) -> int:
        """The fewest slabs whose expected error is at most ``allowed`` levels; MOST_SLABS where none are enough."""
        return next((slabs for slabs in SLABS if self.error(slabs) <= allowed), MOST_SLABS)


def measured_us(ratios, counted_us: tuple[float, float]) -> tuple[float, float]:
    """``RayCost.measured_us`` from the ratios of the times that some rays took to those that were counted for them.

    They scale what was counted, by the least ratio: a slope through several would carry the noise of so short a work to
    eight times as many slabs.
    """
    return counted_us[0] * min(ratios), counted_us[1] * min(ratios)


def _milliseconds(microseconds: tuple[float, float], rays: int, slabs: int) -> float:
    return 1e-3 * rays * (microseconds[0] + slabs * microseconds[1])
