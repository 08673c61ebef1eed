"""Pictures of volumes that are too large: with voxels twice as large until they fit, or as often as is asked for."""

from dataclasses import replace
from functools import partial

from ..effects.mixing import is_mixed
from ..runtime.steps import announce
from ..scene import Quality, Scene, TooLargeError
from ..volume.few_planes import LARGE
from ..volume.reduced import average, majority, reduce_steps, sample_steps
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
        As ``render_steps`` does; TooLargeError only for a volume of few voxels.
    """
    most = _most_halvings(scene)
    is_sampled = is_draft and scene.volume.holds_values and scene.volume.voxels.nbytes > LARGE
    while is_sampled and scene.volume.voxels.nbytes > SAMPLED_BYTES * 8**halvings:
        halvings += 1
    halvings = min(halvings, most)
    function = scene.transfer_function.classification_key
    contents = scene.volume.key, function, quality.classification, is_mixed(scene)
    while halvings < most and cache.has(TOO_LARGE, (contents, halvings)):
        halvings += 1
    while True:
        shown = yield from _coarser_steps(scene, cache, halvings, is_sampled)
        try:
            rendering = yield from render_steps(shown, quality, cache=cache, refuse_empty_view=False)
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
    """How often the voxels of a scene can be halved."""
    if not scene.volume.holds_values:
        return 0
    return max((min(scene.volume.shape_xyz) // LEAST_SIDE).bit_length() - 1, 0)


def _coarser_steps(scene: Scene, cache: StageCache, halvings: int, is_sampled: bool):
    """Generator of Progress: the scene with half as many voxels along each side, so often."""
    if not halvings:
        return scene
    job = cache.job()

    def volume_steps(volume, merge=average):
        if is_sampled:
            make = partial(sample_steps, volume, halvings)
            return (yield from job.steps("some voxels", (volume.key, halvings), make, lambda made: made.voxels.nbytes))
        for _ in range(halvings):
            make = partial(reduce_steps, volume, HALVED, merge)
            steps = job.steps("larger voxels", (volume.key, merge), make, lambda made: made.voxels.nbytes)
            volume = yield from announce(steps, 0.0, 0.0, AVERAGING)
        return volume

    spacing = float(scene.volume.spacing.min())

    def function_of(function):  # voxels twice as far apart would be half as dense by themselves
        return function and replace(function, opacity_unit_distance=function.opacity_unit_distance or spacing)

    volume, labels, channels = (yield from volume_steps(scene.volume)), scene.labels, []
    if labels is not None:
        functions = {label: function_of(one) for label, one in labels.functions.items()}
        labels = replace(labels, volume=(yield from volume_steps(labels.volume, majority)), functions=functions)
    for one in scene.channels:
        made = yield from volume_steps(one.volume)
        channels.append(replace(one, volume=made, transfer_function=function_of(one.transfer_function)))
    job.keep()
    return replace(
        scene, volume=volume, transfer_function=function_of(scene.transfer_function), labels=labels,
        channels=tuple(channels),
    )  # fmt: skip
