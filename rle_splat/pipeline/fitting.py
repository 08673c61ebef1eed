"""Pictures of volumes that are too large: with voxels twice as large until they fit, or as often as is asked for."""

from dataclasses import replace
from functools import partial

from ..effects.mixing import is_mixed
from ..runtime.steps import announce
from ..scene import Quality, Scene, TooLargeError
from ..volume.few_planes import LARGE
from ..volume.reduced import reduce_steps, sample_steps
from .render import render_steps
from .stage_cache import StageCache

HALVED = 2, 2, 2  # voxels that are averaged along x, y and z
SAMPLED_BYTES = 1 << 27  # of the voxels that a draft of a large volume reads
LEAST_SIDE = 32  # voxels along the shortest side of a volume that is made coarser
AVERAGING, TOO_LARGE = "Averaging voxels", "too large"  # a message, and a stage of the cache


def fitting_steps(scene: Scene, quality: Quality, cache: StageCache, halvings: int = 0, *, is_draft: bool = False):
    """Generator of Progress: a picture of the volume itself, or of a coarser one where its tables do not fit in memory.

    What does not fit is kept in the cache, and tried again after an edit of the transfer function.

    Parameters
    ----------
    halvings : int
        How often the number of voxels along each side is halved at least, where that is possible.
    is_draft : bool
        Of a large volume read a few voxels alone, without averaging: all of them take minutes where it has many GiB.

    Returns
    -------
    rendering : Rendering
    halvings : int
        How often it was halved.

    Raises
    ------
    RleSplatError
        As ``render_steps`` does; TooLargeError only for scenes with labels or channels, and for a volume of few voxels.
    """
    most = _most_halvings(scene)
    is_sampled = is_draft and scene.volume.holds_values and scene.volume.voxels.nbytes > LARGE
    while is_sampled and scene.volume.voxels.nbytes > SAMPLED_BYTES * 8**halvings:
        halvings += 1
    halvings = min(halvings, most)
    contents = scene.volume.key, scene.transfer_function.classification_key, quality.classification
    while halvings < most and cache.has(TOO_LARGE, (contents, halvings)):
        halvings += 1
    while True:
        shown = yield from _coarser_steps(scene, cache, halvings, is_sampled)
        try:
            rendering = yield from render_steps(shown, quality, cache, refuse_empty_view=False)
        except TooLargeError:
            if halvings == most:
                raise
            job = cache.job()
            job.get(TOO_LARGE, (contents, halvings), lambda: True, lambda _: 1)
            job.keep()
            halvings += 1
        else:
            return rendering, halvings


def _most_halvings(scene: Scene) -> int:
    """How often the voxels of a scene can be halved; those of labels and channels belong to the volume's own grid."""
    if is_mixed(scene) or not scene.volume.holds_values:
        return 0
    return max((min(scene.volume.shape_xyz) // LEAST_SIDE).bit_length() - 1, 0)


def _coarser_steps(scene: Scene, cache: StageCache, halvings: int, is_sampled: bool):
    """Generator of Progress: the scene with half as many voxels along each side, so often."""
    if not halvings:
        return scene
    volume, function, job = scene.volume, scene.transfer_function, cache.job()
    if is_sampled:
        make = partial(sample_steps, volume, halvings)
        volume = yield from job.steps("some voxels", (volume.key, halvings), make, lambda made: made.voxels.nbytes)
    for _ in range(0 if is_sampled else halvings):
        make = partial(reduce_steps, volume, HALVED)
        steps = job.steps("larger voxels", volume.key, make, lambda made: made.voxels.nbytes)
        volume = yield from announce(steps, 0.0, 0.0, AVERAGING)
    job.keep()
    # Voxels twice as far apart would be half as dense by themselves.
    distance = float(function.opacity_unit_distance or scene.volume.spacing.min())
    return replace(scene, volume=volume, transfer_function=replace(function, opacity_unit_distance=distance))
