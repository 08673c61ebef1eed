"""The plans to choose from, and their names.

A plan is a ``Quality`` with its accuracy knobs set: depth rule, sheet density, warp filter and termination.  The other
knobs, such as the classification, the record or the threads, stay as the user chose them.
"""

import math
from dataclasses import replace
from itertools import product

from ...scene import NO_RAYS, PRESET_KNOBS, Quality, RleSplatError

# Without slice-2, which errs by tens of levels at edges: no tolerance is that large.
DEPTH_RULES = (
    "slice", "simpson", "gauss2", *(f"midpoint-{m}" for m in (1, 2, 3, 4, 6, 8, 12, 16, 24, 32)),
)  # fmt: skip
PREINTEGRATED_RULES = ("preintegrated", *(f"preintegrated-{m}" for m in (2, 3, 4, 6, 8)))  # scalar sheets only
SHEET_DENSITIES = (0.5, 0.7, 1.0, 1.25, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 12.0, 16.0)
WARP_FILTERS = ("bilinear", "keys", "cubic")
PLANNED = "planned"  # the name of a quality that was chosen for a tolerance
KEPT_KNOBS = tuple(knob for knob in PRESET_KNOBS if knob != "rays")  # of a plan that is kept from frame to frame
# The only value of each knob with which pictures converge to the truth, and why.
PROMISED = {
    "model": ("extinction", "the reference integrates extinction"),
    "kernel": ("tent", "the reference interpolates linearly"),
    "minification": ("off", "the reference integrates along one ray for each pixel"),
    "length_correction": (True, "the reference integrates over the length of the ray"),
}


def depth_rules(classification: str) -> tuple[str, ...]:
    """The depth rules to choose from, for a classification."""
    return (*DEPTH_RULES, *PREINTEGRATED_RULES) if classification == "post" else DEPTH_RULES


def candidates(base: Quality) -> list[Quality]:
    """All combinations of depth rule, sheet density and warp filter, with the other knobs of ``base``.

    The axis fade is off, because a picture along either principal axis keeps the tolerance.
    """
    return [
        candidate(base, depth_rule=rule, sheet_density=density, warp_filter=warp_filter)
        for rule, density, warp_filter in product(depth_rules(base.classification), SHEET_DENSITIES, WARP_FILTERS)
    ]


def candidate(base: Quality, **knobs) -> Quality:
    """One of them, with these knobs."""
    return replace(base, name=PLANNED, held=False, axis_fade=0.0, rays=NO_RAYS, **knobs)


def name_of(plan: Quality) -> str:
    """A plan's name for people, such as ``pre slice 1.0 cubic``: classification, depth rule, sheet density, filter."""
    density = f"{plan.sheet_density:.2f}".rstrip("0")
    density += "0" if density.endswith(".") else ""
    return f"{plan.classification} {plan.depth_rule} {density} {plan.warp_filter}"


def check_plannable(quality: Quality) -> None:
    """Raise RleSplatError for knobs with which no plan converges to the truth."""
    for name, (only, why) in PROMISED.items():
        value = getattr(quality, name)
        if value != only:
            raise RleSplatError(
                f"A tolerance cannot be met with {name.replace('_', ' ')} {value!r}, because {why}; use {only!r}, or "
                "leave the tolerance out."
            )


def check_tolerance(tolerance) -> float:
    """The tolerance as a number of levels; raises RleSplatError unless it is finite and above zero."""
    try:
        levels = float(tolerance)
    except (TypeError, ValueError):
        levels = math.nan
    if not (math.isfinite(levels) and levels > 0.0):
        raise RleSplatError(
            f"A tolerance is a number of 8-bit steps (1/255) above zero, such as 1, not {tolerance!r}: every picture "
            "has some error."
        )
    return levels
