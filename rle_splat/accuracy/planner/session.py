"""The set-up that all uses of the planner share: pilots, features, error estimates and speed of one scene.

``tolerance`` chooses and renders one plan with it; ``measure_plans`` predicts the plans of several tolerances.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...effects.analyze import analyze_effects
from ...pipeline.choose_source import choose_source
from ...pipeline.plan_model import Features, Model
from ...pipeline.render import render_steps
from ...pipeline.single_rays import can_trace
from ...pipeline.stage_cache import StageCache
from ...runtime.steps import Progress, announce, map_steps, rescale
from ...scene import Quality, Rendering, Scene
from .choose import NEARLY_BEST, STAGES, Choice, Speed, choose, choose_with_rays
from .error_estimate import ErrorEstimate
from .features import PILOTS, features_of, pilots
from .machine import MachineProfile, profile_steps
from .ray_cost import RayCost
from .single_rays import ray_cost_steps, single_ray_steps

TRACING = "Computing exact pixels"
PILOT_ROUNDS = 2


@dataclass(eq=False)
class PlannerSession:
    """One scene, and what plans for it are chosen by.

    Attributes
    ----------
    scene : Scene
        As it was given.
    shown : Scene
        The scene without the effects that are off.
    quality : Quality
        What no plan decides, such as the classification, the record and the threads.
    refuse_empty_view : bool
        As ``render_steps`` takes it.
    machine : MachineProfile
        By which plans are chosen.
    pilots : dict
        Names of the pilots -> their plan, and the milliseconds of its stages, the least of PILOT_ROUNDS.
    latest : tuple or None
        The same of the latest picture for a tolerance.
    estimate : ErrorEstimate or None
        None where the scene or the classification has no single rays.
    ray_cost : RayCost or None
        Given with ``estimate``.
    """

    scene: Scene
    shown: Scene
    quality: Quality
    cache: StageCache
    refuse_empty_view: bool
    model: Model
    features: Features
    machine: MachineProfile
    pilots: dict
    latest: tuple | None = None
    estimate: ErrorEstimate | None = None
    ray_cost: RayCost | None = None

    def choose(
        self, tolerance: float, correction: float = 1.0, slack: float = NEARLY_BEST, only: Quality | None = None
    ) -> Choice:
        """Choose the plan for a tolerance, with single rays where the scene has them.

        The plan depends on the scene and the profile of the machine alone; its times are those expected in this run.

        Parameters
        ----------
        tolerance : float
            Levels.
        correction : float
            As ``Model.errors`` takes it.
        slack : float
            As ``choose.choose`` takes it; it has no meaning with single rays.
        only : Quality, optional
            Choose for the sheets of this plan alone.
        """
        given = self.features, self.quality, tolerance, self.model
        if self.estimate is None:
            return self._with_expected_times(choose(*given, self.machine, correction, slack, only))
        rays = self.estimate, self.ray_cost
        return self._with_expected_times(choose_with_rays(*given, *rays, self.machine, correction, only))

    def _with_expected_times(self, choice: Choice) -> Choice:
        """The choice with the times that are expected in this run."""
        speed = Speed.of(self.model, self.features, self.pilots, choice.plan, self.latest)
        rays_ms = 0.0
        if choice.rays:
            rays_ms = self.ray_cost.expected_ms(choice.rays, choice.slabs)
        splat, warp = choice.splat_ms / self.machine.splat, choice.warp_ms / self.machine.warp
        return replace(choice, splat_ms=splat * speed.splat, warp_ms=warp * speed.warp, rays_ms=rays_ms)

    def picture_steps(self, plan: Quality, begin: float, end: float, message: str):
        """Generator of Progress from ``begin`` to ``end``: render a plan's sheets; returns the Rendering."""
        return picture_steps(self.scene, plan, self.cache, begin, end, message, self.refuse_empty_view)

    def traced_steps(
        self, columns, rows, slabs: int, plan: Quality, begin: float, end: float, message=lambda done: TRACING
    ):
        """Generator of Progress from ``begin`` to ``end``: trace pixels of a plan's picture by single rays.

        ``message``: the message of progress for a fraction of the rays that is done.  Returns premultiplied rgba (n, 4)
        float32 and the milliseconds that the rays took.
        """
        quality = replace(self.quality, termination=plan.termination)
        steps = single_ray_steps(self.shown, quality, columns, rows, slabs, self.cache)
        rgba, _, spent = yield from map_steps(steps, lambda done: Progress(begin + (end - begin) * done, message(done)))
        return rgba, spent

    def ray_pixels(self, choice: Choice, correction: float = 1.0) -> np.ndarray:
        """(H, W) bool: pixels that the choice has traced, because its sheets and warp would err too much there."""
        return self.estimate.levels(self.model, choice.plan, correction) > choice.allowed


def picture_steps(
    scene: Scene, plan: Quality, cache: StageCache, begin: float, end: float, message: str,
    refuse_empty_view: bool = True,
):  # fmt: skip
    """Generator of Progress from ``begin`` to ``end``: render a plan; returns the Rendering.

    ``message`` stands in place of the pipeline's own messages, except where kernels are compiled.
    """

    def show_step(step: Progress) -> Progress:
        fraction = begin + (end - begin) * step.fraction
        return Progress(fraction, step.message if "kernels" in step.message else message)

    return map_steps(render_steps(scene, plan, cache=cache, refuse_empty_view=refuse_empty_view), show_step)


def session_steps(scene: Scene, quality: Quality, cache: StageCache, end: float, refuse_empty_view: bool = True):
    """Render the pilots of a scene and set up a session.

    Generator of Progress from 0 to ``end``; returns the PlannerSession.  Raises RleSplatError where the classification
    has no calibrated model.
    """
    model, quality = Model.of(quality.classification), replace(quality, exact_light=quality.classification == "post")
    plans, drawn, times = pilots(quality), {}, {name: [] for name in PILOTS}
    # Twice: the first time a frame also waits for memory that later ones find at hand.
    for number, (name, plan) in enumerate(PILOT_ROUNDS * (*plans.items(),)):
        span = end * number / (PILOT_ROUNDS * len(plans)), end * (number + 1) / (PILOT_ROUNDS * len(plans))
        drawn[name] = yield from picture_steps(scene, plan, cache, *span, "Looking at the scene", refuse_empty_view)
        times[name].append(drawn[name].report["stages_ms"])
    timed = {
        name: (plan, {stage: min(one[stage] for one in times[name]) for stage in STAGES})
        for name, plan in plans.items()
    }
    features, shown = features_of(scene, quality, drawn), analyze_effects(scene, quality)[1]
    machine = yield from rescale(profile_steps(quality), end, end)
    session = PlannerSession(scene, shown, quality, cache, refuse_empty_view, model, features, machine, timed)
    if can_trace(choose_source(shown, quality)):
        session.estimate = ErrorEstimate.of(drawn)
        steps = ray_cost_steps(shown, quality, session.estimate, machine.cell_us, machine.slab_us, cache)
        session.ray_cost = yield from announce(steps, end, end, TRACING)
    return session


def with_pixels(rendering: Rendering, columns, rows, values) -> Rendering:
    """The rendering with other ``values`` (n, 4) at some pixels."""
    rgba = rendering.rgba.copy()
    rgba[rows, columns] = values
    return replace(rendering, rgba=rgba)
