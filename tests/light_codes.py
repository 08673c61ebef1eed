"""Codes of the light at voxels of a strict picture, and what the reference says of the same voxels."""

import numpy as np

from rle_splat.accuracy.light_model import PostLight
from rle_splat.accuracy.truths import world_opacity_distance
from rle_splat.pipeline import scalar_source
from rle_splat.pipeline.render import render
from rle_splat.scene import Quality


def codes_and_reference(scene, step: int, monkeypatch):
    """(codes, reference, z) of every ``step``-th kept voxel: planes of light, and the slice of each voxel."""
    found, code_steps = [], scalar_source.code_steps

    def note(scene, scalars, *rest):
        codes, key = yield from code_steps(scene, scalars, *rest)
        found.append((scalars.voxels, codes))
        return codes, key

    monkeypatch.setattr(scalar_source, "code_steps", note)
    render(scene, Quality.preset("strict"))
    (voxels, codes), rows = found[0], scene.volume.shape_xyz[1]
    few = np.arange(0, len(voxels), step)
    row = np.searchsorted(voxels.row_start, few, side="right") - 1
    reference = PostLight(scene, world_opacity_distance(scene, scene.transfer_function))
    return codes[few], reference.planes(row // rows, row % rows, voxels.column[few].astype(np.int64)), row // rows
