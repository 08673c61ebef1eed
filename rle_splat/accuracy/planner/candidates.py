"""The plans to choose from, and what to call them.

A plan is a ``Quality`` whose knobs of accuracy are set; what the user chose beside them, such as the classification,
the record or the threads, stays as it is.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import product

from ...scene import NO_RAYS, Quality, RleSplatError, midpoints_of, preintegrated_of

# Not slice-2: whatever is coarse enough for its errors, of tens of levels at edges, is too coarse to be promised.
DEPTH_RULES = (
    "slice", "simpson", "gauss2", *(f"midpoint-{m}" for m in (1, 2, 3, 4, 6, 8, 12, 16, 24, 32)),
)  # fmt: skip
PREINTEGRATED_RULES = ("preintegrated", *(f"preintegrated-{m}" for m in (2, 3, 4, 6, 8)))  # of sheets of the scalar
SHEET_DENSITIES = (0.5, 0.7, 1.0, 1.25, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 12.0, 16.0)
WARP_FILTERS = ("bilinear", "keys", "cubic")
SHEETS_PER_VOXEL = {"slice": 1, "simpson": 2, "gauss2": 2}
PLANNED = "planned"  # the name of a quality that was chosen for a tolerance
# Knobs under which the truth is another picture, whatever the plan, and why.
PROMISED = {
    "model": ("extinction", "the truth adds up extinction"),
    "kernel": ("tent", "the truth interpolates linearly"),
    "minification": ("off", "the truth shows what lies on a pixel's ray"),
    "length_correction": (True, "the truth knows how long rays are"),
}


def depth_rules(classification: str) -> tuple[str, ...]:
    """The depth rules to choose from."""
    return (*DEPTH_RULES, *PREINTEGRATED_RULES) if classification == "post" else DEPTH_RULES


def candidates(base: Quality) -> list[Quality]:
    """Every plan of the grid, its other knobs as in ``base``; along either principal axis a tolerance is kept."""
    return [
        replace(
            base, name=PLANNED, axis_fade=0.0, rays=NO_RAYS, depth_rule=rule, sheet_density=density,
            warp_filter=warp_filter,
        )
        for rule, density, warp_filter in product(depth_rules(base.classification), SHEET_DENSITIES, WARP_FILTERS)
    ]


def name_of(plan: Quality) -> str:
    """A plan's name for people, such as ``pre slice 1.0 cubic``: classification, depth rule, density, filter."""
    density = f"{plan.sheet_density:.2f}".rstrip("0")
    density += "0" if density.endswith(".") else ""
    finer = f" x{plan.refinement}" if plan.classification == "refined" else ""
    return f"{plan.classification}{finer} {plan.depth_rule} {density} {plan.warp_filter}"


def family_of(depth_rule: str) -> tuple[str, int]:
    """A rule's family, ``midpoint`` or ``preintegrated`` or its own name, and the sheets that a voxel's depth takes."""
    for family, count in (("midpoint", midpoints_of(depth_rule)), ("preintegrated", preintegrated_of(depth_rule))):
        if count is not None:
            return family, count
    return depth_rule, SHEETS_PER_VOXEL[depth_rule]


def check_plannable(quality: Quality) -> None:
    """RleSplatError for knobs under which nothing can be promised."""
    for name, (only, why) in PROMISED.items():
        value = getattr(quality, name)
        if value != only:
            raise RleSplatError(
                f"A tolerance cannot be kept with {name.replace('_', ' ')} {value!r}, because {why}; use {only!r}, or "
                "leave the tolerance out."
            )


def check_tolerance(tolerance) -> float:
    """The tolerance as a number of levels; RleSplatError when it is none."""
    try:
        levels = float(tolerance)
    except (TypeError, ValueError):
        levels = math.nan
    if not (math.isfinite(levels) and levels > 0.0):
        raise RleSplatError(
            f"A tolerance is a number of levels (1/255) above zero, such as 1, not {tolerance!r}: no picture is free "
            "of error."
        )
    return levels
