"""The quickest plan that keeps a tolerance, and the next one where the measured error exceeds it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...pipeline.memory_estimate import COEFFICIENTS, SHEET_PIXEL, SPARE
from ...pipeline.plan_model import ErrorBudget, Features, Model, family_of
from ...scene import Quality
from .candidates import DEPTH_RULES, candidates
from .error_estimate import ErrorEstimate
from .features import LEVELS, PILOTS
from .machine import MachineProfile
from .ray_cost import RayCost

SAFETY = 0.9  # of the tolerance: the largest expected error of a plan that keeps it
TERMINATION_SHARE = 0.1  # of the tolerance: the error of ending rays early
LARGEST_TERMINATION = 1 / 256
LEAST_TERMINATION = 1e-7
# A correction is increased by this: with better plans, the largest error falls a little slower than the typical one.
CAUTION = 1.15
# Where no plan keeps the tolerance: the quickest plan whose error is at most this times the least one is rendered.
NEARLY_BEST = 1.25
STAGES = ("splat", "warp")  # whose times the model knows
RAY_SHARE = 0.5  # of a plan's allowed error: the largest expected error of its single rays


@dataclass(frozen=True)
class Choice:
    """A plan with its expected error and time.

    Attributes
    ----------
    errors : ErrorBudget
        Expected, in levels.
    splat_ms, warp_ms : float
        Expected milliseconds.
    keeps : bool
        Whether the plan is expected to keep the tolerance.
    rays : int
        Pixels that single rays trace, because the sheets and the warp would err more than ``allowed`` there.
    slabs : int
        Slabs that a voxel's depth is cut into along single rays.
    rays_ms : float
        Expected milliseconds of the single rays.
    allowed : float
        Levels.
    """

    plan: Quality
    errors: ErrorBudget
    splat_ms: float
    warp_ms: float
    keeps: bool
    rays: int = 0
    slabs: int = 0
    rays_ms: float = 0.0
    allowed: float = np.inf

    @property
    def milliseconds(self) -> float:
        """The expected time of a frame."""
        return self.splat_ms + self.warp_ms + self.rays_ms


@dataclass(frozen=True)
class Speed:
    """The time of a plan's splat and warp here, over the time where the model was calibrated."""

    splat: float = 1.0
    warp: float = 1.0

    @classmethod
    def of(cls, model: Model, features: Features, pilots: dict, plan: Quality, latest: tuple | None = None) -> Speed:
        """Make one from ``pilots``: their names -> pairs of a plan and the milliseconds of its stages.

        That of the splat is interpolated between the pilots, and carried on by at most a factor of two in the density:
        how much of a frame's time grows with the sheets and their pixels depends on the scene.  (Of 65 plans with
        ``post`` on scenes that nothing was calibrated on, 98 % of the times are within 1.5; by the median pilot, 86 %.)

        ``latest``: such a pair of a picture for a tolerance, which tells more of the next one than the pilots.
        """

        def ratios_of(drawn: Quality, stages: dict) -> list[float]:
            expected = model.milliseconds(features, drawn)
            return [max(stages[stage] / max(ms, 1e-6), 1e-3) for stage, ms in zip(STAGES, expected)]

        if latest is not None:
            return cls(*ratios_of(*latest))
        ratios = {name: ratios_of(*pilot) for name, pilot in pilots.items()}
        coarse, deep, dense = (ratios[name][0] for name in ("coarse", "deep", "dense"))
        doublings = np.log2((plan.sheet_density / PILOTS["coarse"][1], family_of(plan.depth_rule)[1]))
        denser, deeper = np.clip(doublings, (-1.0, 0.0), 1.0)
        splat = coarse * (dense / coarse) ** denser * (deep / coarse) ** deeper
        return cls(float(splat), float(np.median([warp for _, warp in ratios.values()])))


def termination_for(tolerance: float, largest_color: float) -> float:
    """The transmittance at which rays end: it changes a channel by at most TERMINATION_SHARE of the tolerance."""
    wanted = TERMINATION_SHARE * tolerance / (LEVELS * max(largest_color, 1.0))
    return float(np.clip(wanted, LEAST_TERMINATION, LARGEST_TERMINATION))


def choose(features: Features, base: Quality, tolerance: float, model: Model, machine: MachineProfile,
           correction: float = 1.0, slack: float = NEARLY_BEST, only: Quality | None = None) -> Choice:  # fmt: skip
    """Choose the quickest plan that is expected to keep a tolerance.

    Parameters
    ----------
    base : Quality
        The knobs that a plan does not decide.
    tolerance : float
        Levels.  A plan keeps it when its expected error is at most SAFETY times the tolerance.
    correction : float
        As ``Model.errors`` takes it.
    slack : float
        Where no plan keeps the tolerance, the quickest one is chosen whose error is at most ``slack`` times that of
        the most accurate plan; its ``keeps`` is False.
    only : Quality, optional
        Choose this plan, whatever is expected of it.
    """
    base = replace(base, termination=termination_for(tolerance, features.largest_color))
    choices = []
    for plan in _plans(features, base, machine, only):
        errors = model.errors(features, plan, correction)
        splat, warp = model.milliseconds(features, plan)
        keeps = errors.total <= SAFETY * tolerance
        choices.append(Choice(plan, errors, splat * machine.splat, warp * machine.warp, keeps))
    enough = [choice for choice in choices if choice.keeps]
    if not enough:
        least = min(choice.errors.total for choice in choices)
        enough = [choice for choice in choices if choice.errors.total <= slack * least]
    return min(enough, key=lambda choice: choice.milliseconds)


def choose_with_rays(
    features: Features, base: Quality, tolerance: float, model: Model, estimate: ErrorEstimate, cost: RayCost,
    machine: MachineProfile, correction: float = 1.0, only: Quality | None = None,
) -> Choice:  # fmt: skip
    """Choose the plan and the single rays that are expected to keep a tolerance in the least time together.

    Single rays trace the pixels where the plan's sheets and warp would err more than is allowed.  The parameters are
    those of ``choose``, and

    Parameters
    ----------
    only : Quality, optional
        Choose single rays for the sheets of this plan alone.

    Returns
    -------
    Choice
        ``keeps`` is False where the rays themselves are expected to err more than is allowed.
    """
    # Any rule serves for the bounds; the base's own may be the draft's slice-2, which is no candidate.
    base = replace(base, termination=termination_for(tolerance, features.largest_color), depth_rule=DEPTH_RULES[0])
    bounds = model.errors(features, base).bounds
    allowed = SAFETY * tolerance - bounds
    slabs = cost.slabs_for(RAY_SHARE * allowed)
    of_rays = cost.error(slabs)
    depth_step, sheet_step, pixels = estimate.bins.T
    choices = []
    for plan in _plans(features, base, machine, only):
        depth, warp = model.constants(plan)
        modeled = correction * np.hypot(depth * depth_step, warp * sheet_step)
        wrong = modeled > allowed
        rays = int(pixels[wrong].sum())
        worst = int(np.argmax(np.where(wrong, -1.0, modeled)))
        parts = (0.0, 0.0) if wrong.all() else (depth * depth_step[worst], warp * sheet_step[worst])
        of_sheets = 0.0 if wrong.all() else modeled[worst]
        errors = model.errors(features, plan)
        if rays and of_rays > of_sheets:
            errors = replace(errors, depth=of_rays, warp=0.0)
        else:
            errors = replace(errors, depth=correction * parts[0], warp=correction * parts[1])
        splat, warped = model.milliseconds(features, plan)
        keeps = errors.total <= SAFETY * tolerance * (1.0 + 1e-9)
        choices.append(Choice(
            plan, errors, splat * machine.splat, warped * machine.warp, keeps, rays, slabs if rays else 0,
            cost.milliseconds(rays, slabs) if rays else 0.0, max(allowed, 0.0),
        ))  # fmt: skip
    enough = [choice for choice in choices if choice.keeps] or choices
    return min(enough, key=lambda choice: choice.milliseconds)


def correct(errors: ErrorBudget, measured: float, correction: float = 1.0) -> float:
    """The new correction, after a plan that was expected to err ``errors`` was found to err ``measured`` levels."""
    beyond = max(measured - errors.bounds, 0.0) / max(errors.modeled, 1e-9)
    return correction * max(CAUTION * beyond, 1.0)


def _plans(features: Features, base: Quality, machine: MachineProfile, only: Quality | None) -> list[Quality]:
    """The candidates whose sheets fit in the machine's memory, or ``only`` one plan.

    All of its memory counts: what is free changes from run to run.  (A picture for which too little is free is refused,
    with the reason.)
    """
    if only is not None:
        return [only]
    a_unit = max(features.sheet_pixels * (SHEET_PIXEL + COEFFICIENTS), 1.0)
    densest = max(float(np.sqrt(SPARE * machine.memory / a_unit)), 1.0)
    return [plan for plan in candidates(base) if plan.sheet_density <= densest]
