"""The source of a picture: what the volume is, how it is classified and lit, and the work that this is part of.

A source is a scan, a scan with labels or channels, or stored tables.  ``choose_source`` picks one; no later stage asks
again.  It makes a medium (see ``medium``), which is all that the stages after shading know of the volume.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from ..effects.analyze import EffectSet
from ..runtime.steps import Clock
from ..scene import Quality, Scene
from ..splat.scratch import scratch_bytes
from ..view.base_plane import BasePlane
from ..volume.axes import AXES
from .medium import Medium
from .memory_estimate import MemoryEstimate, picture_bytes, refuse_too_much
from .stage_cache import Job

NO_EFFECTS = EffectSet(())
ALL_TRANSPARENT = "The transfer function makes every voxel transparent, so the picture is empty."


@dataclass(frozen=True, eq=False)
class Work:
    """The work for one picture or one file.

    Attributes
    ----------
    job : Job
        Stage results, kept or made by this work.
    clock : Clock
        Milliseconds of each stage.
    axes : int
        How many principal axes are encoded.
    picture : int
        Bytes that the picture's pixels take.
    """

    job: Job
    clock: Clock
    axes: int = 1
    picture: int = 0

    def claim(self, needed: MemoryEstimate) -> None:
        """Make room for what is needed; RleSplatError, with what to do, where there is not enough."""
        self.job.cache.make_room(needed.needed)
        refuse_too_much(needed)


@dataclass(frozen=True, eq=False)
class Source(ABC):
    """Where sheets get their voxels from; the base class of all kinds.

    Attributes
    ----------
    scene : Scene
        Without the effects that are off; its volume is the grid that is splatted.
    quality : Quality
        With the classification that the volume and the effects need.
    effects : EffectSet
        State of every effect; without any where the scene was not looked through for them.
    notes : tuple of str
        Sentences on what was asked for and could not be had, for the report.
    plan : dict
        For the report's plan: ``why`` in words, and the errors ``aim`` and ``expected`` (see ``preset_plan``).
    """

    scene: Scene
    quality: Quality
    effects: EffectSet = NO_EFFECTS
    notes: tuple[str, ...] = ()
    plan: dict = field(default_factory=dict)

    scalar_sheets: ClassVar[bool] = False  # whether sheets hold the scalar; the medium then fills the box by itself
    traces_rays: ClassVar[bool] = False  # whether single rays can go through the medium

    @property
    def threads(self) -> int:
        """Number of threads; 0 for one per core."""
        return self.quality.threads

    @property
    def depth_rule(self) -> str:
        """Name of the rule by which sheets integrate along the view."""
        return self.quality.depth_rule

    @property
    def axes(self):
        """The principal axes that there are tables of, or can be."""
        return AXES

    @property
    def remarks(self) -> tuple[str, ...]:
        """Sentences on the source itself, for the report."""
        return tuple(self.scene.volume.remarks)

    def remarks_on(self, medium: Medium) -> tuple[str, ...]:
        """Sentences on what became of it."""
        return () if medium.visible_voxels else (ALL_TRANSPARENT,)

    def picture_bytes(self, planes: list[BasePlane], *, shortened: bool, traced: bool) -> int:
        """What the picture of the scene's region takes; for the arguments see ``memory_estimate.picture_bytes``."""
        scene, quality = self.scene, self.quality
        left, top, right, bottom = scene.region
        knobs = scene.volume.shape_xyz, quality, self.scalar_sheets, shortened
        scratch = max((scratch_bytes(plane, *knobs) for plane in planes), default=0)
        return picture_bytes(
            planes, right - left, bottom - top, quality, shortened=shortened, meshes=scene.hides_volume,
            scratch=scratch, traced=traced,
        )  # fmt: skip

    @abstractmethod
    def classify_steps(self, work: Work):
        """Generator of Progress: the voxels that are visible, or matter, classified and not lit yet.

        Says what memory is about to be taken; raises RleSplatError, with what to do, when there is not enough.
        """

    @abstractmethod
    def shade_steps(self, voxels, work: Work):
        """Generator of Progress: the Medium, lit, its tables still to be made.

        ``voxels``: what ``classify_steps`` returned.
        """

    def medium_steps(self, work: Work):
        """Generator of Progress: classify and shade; returns the Medium."""
        voxels = yield from self.classify_steps(work)
        return (yield from self.shade_steps(voxels, work))


def array_key(*arrays) -> tuple:
    """The bytes of arrays, as a part of a stage's key."""
    return tuple(np.ascontiguousarray(array).tobytes() for array in arrays)
