"""Lacroute and Levoy's shear-warp factorization, as settings of our renderer.

P. Lacroute and M. Levoy, Fast volume rendering using a shear-warp factorization of the viewing transformation,
SIGGRAPH 1994: the paper's [7].
"""

from ..scene import Quality
from . import ours
from .medium import ShadedScene
from .system import ReadySystem

# Rays end at an opacity of 95 %, the usual limit of shear-warp programs.
TERMINATION = 0.05
DIFFERS = (
    "Slice planes, one sheet pixel per voxel, opacity resampled linearly within a slice and corrected for the "
    "length of the ray, a bilinear warp, termination at a transmittance of 0.05. The original keeps 8 bits a "
    "channel where we keep floats, looks shading up per frame, and has no perspective in its published program."
)


def shear_warp(**overrides) -> Quality:
    """The quality with which our renderer does the same as the shear-warp program."""
    return Quality(
        classification="pre", depth_rule="slice", sheet_density=0.0, kernel="tent", warp_filter="bilinear",
        termination=TERMINATION, model="opacity", length_correction=True, name="shear-warp", **overrides,
    )  # fmt: skip


def prepare(medium: ShadedScene, quality: Quality) -> ReadySystem:
    """Our renderer with the shear-warp settings; only the threads of ``quality`` count."""
    return ours.prepare(medium, shear_warp(threads=quality.threads))
