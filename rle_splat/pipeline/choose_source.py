"""The door of the pipeline: decide once what the volume is, how it is classified and which effects there are."""

from ..effects.analyze import analyze_effects
from ..effects.ray_mode import mode_quality
from ..scene import Quality, Scene
from .file_source import FileSource
from .scalar_file_source import ScalarFileSource
from .scalar_source import ScalarSource
from .scan_source import make_scan_source
from .source import Source

SOURCES = {"pre": make_scan_source, "post": ScalarSource}


def choose_source(scene: Scene, quality: Quality) -> Source:
    """The source of a picture, with what the scene's effects and its volume make of the quality.

    Raises
    ------
    RleSplatError
        Where there is no such quality.
    """
    if quality.classification == "post" and not scene.volume.holds_values:
        quality = quality.classified(scene.volume.classification)
    effects, left = analyze_effects(scene, quality)
    by_mode, note = mode_quality(left, quality)
    if note:
        quality = by_mode
        effects, left = analyze_effects(scene, quality)
    notes = (note,) if note else ()
    if left.volume.holds_values:
        return SOURCES[quality.classification](left, quality, effects, notes)
    make = ScalarFileSource.of if left.volume.classification == "post" else FileSource
    return make(left, quality, effects, notes)
