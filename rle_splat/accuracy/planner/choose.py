"""The cheapest plan that keeps a tolerance, and the next one when a measurement says that it did not."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...pipeline.memory_estimate import SPARE
from ...runtime.memory import available_bytes
from ...scene import Quality
from ...splat.sizes import SHEET_PIXEL
from ...warp.sizes import COEFFICIENTS
from .candidates import DEPTH_RULES, candidates
from .error_estimate import Doubt, RayCost
from .features import LEVELS, Features
from .model import ErrorBudget, Model

SAFETY = 0.9  # of the tolerance is what a plan may be expected to err
TERMINATION_SHARE = 0.1  # of the tolerance goes to ending rays early
LARGEST_TERMINATION = 1 / 256
LEAST_TERMINATION = 1e-7
# A scene that errs more than its model says is taken to err somewhat more still: the largest error of a better plan
# falls a little slower than the typical one.
CAUTION = 1.15
# What no plan keeps is rendered by the quickest plan that errs hardly more than the most accurate one.
NEARLY_BEST = 1.25
RAY_SHARE = 0.5  # of what a plan may err is what single rays may


@dataclass(frozen=True)
class Choice:
    """A plan, what it is expected to err and to take (splat and warp), and whether it is expected to keep the
    tolerance: if not, there is hardly a more accurate one.

    ``rays``: pixels that are had by rays of their own, because the plan's sheets and warp would err more than
    ``allowed`` levels there; ``slabs``: that a voxel's depth is cut into along them; ``rays_ms``: what they take."""

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
        return self.splat_ms + self.warp_ms + self.rays_ms


@dataclass(frozen=True)
class Speed:
    """How many times longer splat and warp take here than where the model was calibrated."""

    splat: float = 1.0
    warp: float = 1.0

    @classmethod
    def of(cls, model: Model, features: Features, frames) -> Speed:
        """From ``frames``: pairs of a plan and the ``stages_ms`` of its report.

        Where frames disagree their middle counts: what else a machine does meets them unevenly.
        """
        ratios = []
        for plan, stages in frames:
            splat, warp = model.milliseconds(features, plan)
            ratios.append((stages["splat"] / max(splat, 1e-6), stages["warp"] / max(warp, 1e-6)))
        return cls(*(float(middle) for middle in np.median(np.maximum(ratios, 1e-3), axis=0)))


def termination_for(tolerance: float, largest_color: float) -> float:
    """The transmittance to end rays at: its share of the tolerance is the most that this can change a channel."""
    wanted = TERMINATION_SHARE * tolerance / (LEVELS * max(largest_color, 1.0))
    return float(np.clip(wanted, LEAST_TERMINATION, LARGEST_TERMINATION))


def choose(features: Features, base: Quality, tolerance: float, model: Model, speed: Speed = Speed(),
           correction: float = 1.0, slack: float = NEARLY_BEST) -> Choice:  # fmt: skip
    """The plan that is expected to be quickest of those expected to err at most SAFETY times the tolerance, in levels;
    without any, the quickest of those that err at most ``slack`` times what the most accurate one does, and ``keeps``
    is False.

    ``base``: what the plan does not decide.  ``correction``: as ``Model.errors`` has it.
    """
    base = replace(base, termination=termination_for(tolerance, features.largest_color))
    densest = _densest_that_fits(features)
    choices = []
    for plan in candidates(base):
        if plan.sheet_density <= densest:
            errors = model.errors(features, plan, correction)
            splat, warp = model.milliseconds(features, plan)
            keeps = errors.total <= SAFETY * tolerance
            choices.append(Choice(plan, errors, splat * speed.splat, warp * speed.warp, keeps))
    enough = [choice for choice in choices if choice.keeps]
    if not enough:
        least = min(choice.errors.total for choice in choices)
        enough = [choice for choice in choices if choice.errors.total <= slack * least]
    return min(enough, key=lambda choice: choice.milliseconds)


def choose_with_rays(
    features: Features, base: Quality, tolerance: float, model: Model, doubt: Doubt, cost: RayCost,
    speed: Speed = Speed(), correction: float = 1.0, only: Quality | None = None,
) -> Choice:  # fmt: skip
    """As ``choose``, where pixels that a plan would get wrong are had by rays: the plan and the rays that are expected
    to be quickest together; ``only``: with the sheets of this plan.  ``keeps`` is False where the rays themselves are
    expected to err more than is allowed."""
    # The rule is that of no plan yet; the base's own may be slice-2, a draft's, which can never be promised.
    base = replace(base, termination=termination_for(tolerance, features.largest_color), depth_rule=DEPTH_RULES[0])
    densest = _densest_that_fits(features)
    bounds = model.errors(features, base).bounds
    allowed = SAFETY * tolerance - bounds
    slabs = cost.slabs_for(RAY_SHARE * allowed)
    of_rays = cost.error(slabs)
    depth_step, sheet_step, pixels = doubt.bins.T
    choices = []
    for plan in candidates(base) if only is None else [only]:
        if plan.sheet_density <= densest:
            depth, warp = model.constants(plan)
            modelled = correction * np.hypot(depth * depth_step, warp * sheet_step)
            wrong = modelled > allowed
            rays = int(pixels[wrong].sum())
            worst = int(np.argmax(np.where(wrong, -1.0, modelled)))
            parts = (0.0, 0.0) if wrong.all() else (depth * depth_step[worst], warp * sheet_step[worst])
            of_sheets = 0.0 if wrong.all() else modelled[worst]
            errors = model.errors(features, plan)
            if rays and of_rays > of_sheets:
                errors = replace(errors, depth=of_rays, warp=0.0)
            else:
                errors = replace(errors, depth=correction * parts[0], warp=correction * parts[1])
            splat, warped = model.milliseconds(features, plan)
            keeps = errors.total <= SAFETY * tolerance * (1.0 + 1e-9)
            choices.append(Choice(
                plan, errors, splat * speed.splat, warped * speed.warp, keeps, rays, slabs if rays else 0,
                cost.milliseconds(rays, slabs) if rays else 0.0, max(allowed, 0.0),
            ))  # fmt: skip
    enough = [choice for choice in choices if choice.keeps] or choices
    return min(enough, key=lambda choice: choice.milliseconds)


def corrected(errors: ErrorBudget, measured: float, correction: float = 1.0) -> float:
    """The correction after a plan that was expected to err ``errors`` was found to err ``measured`` levels."""
    beyond = max(measured - errors.bounds, 0.0) / max(errors.modelled, 1e-9)
    return correction * max(CAUTION * beyond, 1.0)


def _densest_that_fits(features: Features) -> float:
    """The largest sheet density that there is memory for; never below one."""
    a_unit = max(features.sheet_pixels * (SHEET_PIXEL + COEFFICIENTS), 1.0)
    return max(float(np.sqrt(SPARE * available_bytes() / a_unit)), 1.0)
