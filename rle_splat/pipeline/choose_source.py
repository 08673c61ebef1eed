"""The door of the pipeline: decide once what the volume is, how it is classified and which effects there are."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import lru_cache

from ..effects.analyze import EffectSet, analyzed
from ..runtime.jit import compiled
from ..scene import Quality, Scene
from .file_source import FileSource
from .scalar_file_source import ScalarFileSource
from .scalar_source import ScalarSource
from .scan_source import scan_source
from .source import Source

SOURCES = {"pre": scan_source, "post": ScalarSource}


@dataclass(frozen=True, eq=False)
class Settled:
    """A scene and a quality that go together.

    Attributes
    ----------
    scene : Scene
        Without the effects that are off.
    quality : Quality
        With a backend that is settled, and with the classification that the volume and the effects need.
    effects : EffectSet
    remarks : tuple of str
        Sentences on what was asked for and could not be had, for the report.
    plan : dict
        For the report's plan: ``why`` in words, and the errors ``aim`` and ``expected`` (see ``preset_plan``).
    """

    scene: Scene
    quality: Quality
    effects: EffectSet
    remarks: tuple[str, ...]
    plan: dict = field(default_factory=dict)


def settled(scene: Scene, quality: Quality) -> Settled:
    """Settle which effects a scene has, and the quality that its volume and its effects can be rendered by.

    Raises
    ------
    RleSplatError
        Where there is no such quality.
    """
    quality = _with_backend(quality, "numba" if compiled(quality.backend) else "numpy")
    if quality.classification == "post" and not scene.volume.holds_values:
        quality = quality.classified(scene.volume.classification)
    effects, left = analyzed(scene, quality)
    fitted, remarks = effects.fitted(left, quality)
    if fitted != quality:
        quality = fitted
        effects, left = analyzed(scene, quality)
    return Settled(left, quality, effects, remarks)


@lru_cache(maxsize=8)
def _with_backend(quality: Quality, backend: str) -> Quality:
    """Kept, since most frames have the previous one's, and a copy checks all of its fields."""
    return replace(quality, backend=backend)


def choose_source(scene: Scene, quality: Quality) -> Source:
    """The source of a scene's voxels; both arguments as ``settled`` returns them."""
    if scene.volume.holds_values:
        return SOURCES[quality.classification](scene, quality)
    make = ScalarFileSource.of if scene.volume.classification == "post" else FileSource
    return make(scene, quality)
