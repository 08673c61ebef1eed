"""The effect mode: X-ray, MIP, MinIP and average instead of emission and absorption (see ``ray_values``)."""

from dataclasses import replace

from ..scene import MODES, POST_ONLY, Quality, RleSplatError, Scene
from ..scene.changed import change
from .kind import Kind

MODE_NAMES = dict(zip(MODES, ("composite", "X-ray", "MIP", "MinIP", "average"), strict=True))

OF_VALUES = ("mip", "minip", "average")  # modes that absorb nothing


def _mode(scene: Scene, _: Quality) -> tuple[bool, str]:
    return scene.mode != MODES[0], f"mode {MODE_NAMES[scene.mode]}"


def mode_quality(scene: Scene, quality: Quality) -> tuple[Quality, str]:
    """The quality that a scene's mode is rendered with: post-classified, because other sheets hold no values.

    Returns
    -------
    quality : Quality
    remark : str
        A sentence on why the quality was changed; "" where it was not.

    Raises
    ------
    RleSplatError
        For a ``.rle`` file in a mode other than composite.
    """
    if scene.mode == MODES[0]:
        return quality, ""
    if not scene.volume.holds_values:
        raise RleSplatError(
            f"A .rle file holds voxels that are classified already; the mode {scene.mode} needs the volume itself."
        )
    if quality.classification == "post":
        return quality, ""
    by_post = replace(quality.classified("pre"), **POST_ONLY, classification="post")
    return (
        by_post,
        f"The mode {scene.mode} shows values, so the classification post was used, not {quality.classification}.",
    )


MODE = Kind(
    "Show absorption alone, or the largest, smallest or mean value of each ray", _mode,
    lambda scene: change(scene, mode=MODES[0]), stage="splat",
)  # fmt: skip
