"""Which scenes a tolerance can be kept for, and which an accuracy sweep can measure."""

from __future__ import annotations

from dataclasses import replace

from ...effects.analyze import analyze_effects
from ...effects.exposure import list_exposures
from ...effects.mixing import is_mixed, split_light
from ...effects.ray_mode import mode_quality
from ...pipeline.shadows import shadow_count
from ...scene import MODES, Quality, RleSplatError, Scene, truth_of
from ..truths import check_shown
from .candidates import check_plannable


def lacks_shadows(scene: Scene, quality: Quality) -> bool:
    """Whether a scene has shadows or ambient occlusion, and the truth of a quality does not."""
    return truth_of(quality) == "T1" and shadow_count(scene) > 0


def lacks_channels(scene: Scene, quality: Quality) -> bool:
    """Whether a scene has labels, or channels that are classified voxel by voxel: there is no truth of these."""
    return scene.labels is not None or (is_mixed(scene) and truth_of(quality) == "T1")


def _refuse_light(scene: Scene) -> None:
    """Raise RleSplatError where channels have a picture each, which add up."""
    if len(split_light(scene)) > 1:
        raise RleSplatError(
            "There is no reference for channels of microscopy that are not lit, whose pictures add up; choose a "
            "quality, or light one of the channels."
        )


def check_tolerance_applies(scene: Scene, quality: Quality) -> None:
    """Raise RleSplatError where a picture of the scene, with the effects that are on, can keep no tolerance."""
    check_plannable(quality)
    if not scene.volume.holds_values:
        raise RleSplatError(
            "A tolerance needs the voxels, which a .rle file does not hold; give the volume it was encoded from, or "
            "choose a quality."
        )
    scene = analyze_effects(scene, quality)[1]
    if scene.mode != MODES[0]:
        raise RleSplatError(f"A tolerance cannot be met in the mode {scene.mode}; choose a quality, or composite.")
    _refuse_light(scene)
    if lacks_channels(scene, quality):
        raise RleSplatError(
            "A tolerance cannot be met with labels, or with channels and the classification pre, because there is no "
            "reference for them; choose a quality, or for channels the classification post."
        )
    if scene.mist is not None:
        raise RleSplatError("A tolerance cannot be met in mist, for which there is no reference; turn the mist off.")
    if scene.ray_ends is not None:
        raise RleSplatError("A tolerance cannot be met where ray ends stand for meshes; give triangles.")
    if scene.transfer_function.gradient_opacity is not None:
        raise RleSplatError(
            "A tolerance cannot be met with gradient opacity, for which there is no reference; turn it off."
        )
    if lacks_shadows(scene, quality):
        raise RleSplatError(
            "A tolerance can only be met without shadows with the classification pre, whose reference has none; turn "
            "off shadows and ambient occlusion, or choose the classification post or a quality."
        )
    if len(list_exposures(scene)) > 1:
        raise RleSplatError(
            "A tolerance is of a single picture: turn off depth of field, motion blur and anti-aliasing, or choose a "
            "quality."
        )


def measurable_scene(scene: Scene, quality: Quality) -> Scene:
    """The whole frame of a scene without the effects that are off, for an accuracy sweep or an error map.

    Raises
    ------
    RleSplatError
        Where the scene has no truth: without voxels, with meshes, mist or labels, and for pre with shadows or channels.
    """
    if not scene.volume.holds_values:
        raise RleSplatError(
            "Accuracy needs the voxels, which a .rle file does not hold; give the volume it was encoded from."
        )
    scene = analyze_effects(scene, quality)[1]
    check_shown(scene, truth_of(mode_quality(scene, quality)[0]))
    if scene.hides_volume or scene.panes is not None:
        raise RleSplatError("Accuracy is measured without meshes; take the meshes out of the scene.")
    _refuse_light(scene)
    if lacks_channels(scene, quality):
        raise RleSplatError(
            "Accuracy cannot be measured with labels, or with channels and the classification pre; take the labels out "
            "of the scene, or choose post (Interpolate: Values)."
        )
    if lacks_shadows(scene, quality):
        raise RleSplatError(
            "Accuracy is measured without shadows with the classification pre; turn off shadows and ambient occlusion, "
            "or choose post."
        )
    return replace(scene, crop=None, antialias=False)
