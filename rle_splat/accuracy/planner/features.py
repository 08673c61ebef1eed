"""Features of a volume and a view, on which a plan's error and time depend beside its knobs.

They are measured on three coarse pictures, the pilots, made from the same tables as the final picture.  Two pilots
differ in the number of sheets per voxel alone: their difference shows, at each pixel, how steep the medium is along the
ray, where depth rules disagree.  Two differ in the sheet density alone, and show how steep the medium is from ray to
ray, obliquity and magnification included.  Their times are used for what users see, not for the choice of a plan.
"""

from dataclasses import replace

import numpy as np

from ...classify.roughness import LEVELS
from ...encode.tables import run_type
from ...pipeline.plan_model import Features
from ...scene import NO_RAYS, Quality, Rendering, Scene
from ...view.base_plane import base_plane
from ...view.eye import index_view
from ...view.footprints import FOOTPRINTS
from ...view.principal_axis import candidate_pyramids

# Depth rule and sheet density of the pilots.  Denser ones take longer and measure no better.
PILOTS = {"coarse": ("slice", 0.7), "deep": ("midpoint-2", 0.7), "dense": ("slice", 1.4)}
PILOT_TERMINATION = 1 / 1024
LEAST_ALPHA = 0.05  # pixels of less alpha give no unassociated color


def pilots(base: Quality) -> dict[str, Quality]:
    """The plans of the pilots, by their names in PILOTS."""
    return {
        name: replace(
            base, name="pilot", depth_rule=rule, sheet_density=density, warp_filter="cubic",
            termination=PILOT_TERMINATION, axis_fade=0.0, rays=NO_RAYS,
        )
        for name, (rule, density) in PILOTS.items()
    }  # fmt: skip


def features_of(scene: Scene, base: Quality, drawn: dict[str, Rendering]) -> Features:
    """Measure the features of a scene on the renderings ``drawn`` of its pilots, by name."""
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
    """(H, W) levels: the largest difference of any channel at each pixel of two pictures of a scene."""
    return LEVELS * np.abs(one.rgba - other.rgba).max(axis=-1)


def _largest(difference: np.ndarray) -> float:
    return float(difference.max(initial=0.0))


def _planes(scene: Scene, base: Quality) -> list:
    """The base planes of the whole frame: slice planes, one sheet pixel for each image pixel."""
    view = index_view(scene.camera, scene.index_to_world, scene.width, scene.height)
    knobs = "slice", 1.0, FOOTPRINTS[base.kernel], base.classification == "post"
    found = [base_plane(view, scene.volume.shape_xyz, *pyramid, *knobs) for pyramid in candidate_pyramids(view)]
    return [plane for plane in found if plane is not None]


def _pixels_per_voxel(planes) -> float:
    """Sheet pixels per voxel at a density of one, nearly image pixels: the median over all sheets."""
    return float(np.median(np.concatenate([plane.scale.min(axis=1) for plane in planes] or [np.ones(1)])))


def _largest_color(rgba: np.ndarray) -> float:
    alpha = rgba[..., 3]
    dense = alpha > LEAST_ALPHA
    return float((rgba[..., :3][dense] / alpha[dense][:, None]).max(initial=0.0))
