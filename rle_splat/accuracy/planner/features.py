"""What a plan's error and time depend on beside its knobs, measured on this volume and this view.

Three coarse pictures, the pilots, are made of the tables that the picture itself will be made of.  Two of them differ
in how many sheets a voxel's depth takes and in nothing else: how far they are apart shows, at every pixel, how steep
the medium is along its rays, which is what depth rules disagree about.  Two differ in the density of the sheets alone,
and show how steep it is from ray to ray, obliquity and magnification included.  What they took tells how fast this
machine is with these tables.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace

import numpy as np

from ...encode.tables import run_type
from ...scene import NO_RAYS, Quality, Rendering, Scene
from ...view.base_plane import base_plane
from ...view.eye import index_view
from ...view.footprints import FOOTPRINTS
from ...view.principal_axis import candidate_pyramids

LEVELS = 255.0
# Depth rule and sheet density of the pilots.  Their largest differences are as good a measure as those of denser ones,
# which take longer.
PILOTS = {"coarse": ("slice", 0.7), "deep": ("midpoint-2", 0.7), "dense": ("slice", 1.4)}
PILOT_TERMINATION = 1 / 1024
LEAST_ALPHA = 0.05  # unassociated colours are read off the pilots where there is so much to divide by


@dataclass(frozen=True)
class Features:
    """JSON-ready.

    ``depth_step``, ``sheet_step``: levels, the largest difference of the pilots in depth and in density.
    ``pixels_per_voxel``: how large voxels are seen.  ``obliquity``: the longest path through a slice over the slice's
    thickness.  ``sheets``: that a ray meets by the rule slice.  ``sheet_pixels``: of the base planes' pictures at a
    density of one; ``row_sheets`` and ``pixel_sheets``: their rows and their pixels, times their sheets.  ``pixels``:
    of the picture.  ``kept_voxels`` and ``runs``: of one axis' tables.  ``largest_color``: channel of an unassociated
    colour.
    """

    classification: str
    depth_step: float
    sheet_step: float
    pixels_per_voxel: float
    obliquity: float
    sheets: int
    row_sheets: float
    pixel_sheets: float
    sheet_pixels: float
    pixels: int
    kept_voxels: int
    runs: int
    largest_color: float

    def report(self) -> dict:
        return asdict(self)


def pilots(base: Quality) -> dict[str, Quality]:
    """The plans of the pilots by their names in PILOTS."""
    return {
        name: replace(
            base, name="pilot", depth_rule=rule, sheet_density=density, warp_filter="cubic",
            termination=PILOT_TERMINATION, axis_fade=0.0, rays=NO_RAYS,
        )
        for name, (rule, density) in PILOTS.items()
    }  # fmt: skip


def features_of(scene: Scene, base: Quality, drawn: dict[str, Rendering]) -> Features:
    """The features of a scene from the renderings of its pilots, by name."""
    planes = _planes(scene, base)
    left, top, right, bottom = scene.region
    pixels = (right - left) * (bottom - top)
    share = pixels / (scene.width * scene.height)  # the planes are those of the whole frame
    report = drawn["deep"].report
    axes = max(len(report["memory_bytes"]["axes_held"]), 1)
    runs = report["memory_bytes"]["runs"] // np.dtype(run_type(scene.volume.shape_xyz)).itemsize // axes
    return Features(
        classification=base.classification,
        depth_step=_largest(difference_of(drawn["coarse"], drawn["deep"])),
        sheet_step=_largest(difference_of(drawn["coarse"], drawn["dense"])),
        pixels_per_voxel=_pixels_per_voxel(planes),
        obliquity=max((_obliquity(plane, scene.index_to_world) for plane in planes), default=1.0),
        sheets=max((len(plane.sheets) for plane in planes), default=0),
        row_sheets=float(sum(plane.height * len(plane.sheets) for plane in planes) * np.sqrt(share)),
        pixel_sheets=float(sum(plane.width * plane.height * len(plane.sheets) for plane in planes) * share),
        sheet_pixels=float(sum(plane.width * plane.height for plane in planes) * share),
        pixels=pixels,
        kept_voxels=int(report["volume"]["visible_voxels"]),
        runs=int(runs),
        largest_color=_largest_color(drawn["dense"].rgba),
    )


def difference_of(one: Rendering, other: Rendering) -> np.ndarray:
    """(H, W) levels: the largest difference of any channel of two pictures of a scene, at each pixel."""
    return LEVELS * np.abs(one.rgba - other.rgba).max(axis=-1)


def _largest(difference: np.ndarray) -> float:
    return float(difference.max(initial=0.0))


def _planes(scene: Scene, base: Quality) -> list:
    """The base planes of the whole frame by slice planes, one sheet pixel an image pixel."""
    view = index_view(scene.camera, scene.index_to_world, scene.width, scene.height)
    knobs = "slice", 1.0, FOOTPRINTS[base.kernel], base.classification == "post"
    found = [base_plane(view, scene.volume.shape_xyz, *pyramid, *knobs) for pyramid in candidate_pyramids(view)]
    return [plane for plane in found if plane is not None]


def _pixels_per_voxel(planes) -> float:
    """Sheet pixels a voxel at a density of one, which are nearly image pixels: the median over all sheets."""
    return float(np.median(np.concatenate([plane.scale.min(axis=1) for plane in planes] or [np.ones(1)])))


def _obliquity(plane, index_to_world) -> float:
    x, y = plane.points()
    corners = np.meshgrid(x[[0, -1]], y[[0, -1]])
    steps = index_to_world[:3, :3] @ plane.ray_steps(*corners).reshape(3, -1)
    straight = np.linalg.norm(index_to_world[:3, plane.axis])
    return float(np.linalg.norm(steps, axis=0).max() / straight)


def _largest_color(rgba: np.ndarray) -> float:
    alpha = rgba[..., 3]
    dense = alpha > LEAST_ALPHA
    return float((rgba[..., :3][dense] / alpha[dense][:, None]).max(initial=0.0))
