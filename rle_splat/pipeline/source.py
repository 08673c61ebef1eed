"""Interfaces of the pipeline: a source of voxels, the medium that it becomes, and the work that both are part of.

A source says what the volume is (a scan, a ``.rle`` file) and how it is classified
(classified or scalar sheets).  ``choose_source`` picks one; no later stage asks again.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..runtime.steps import Clock
from ..scene import Quality, Scene
from ..splat.scratch import scratch_bytes
from ..view.base_plane import BasePlane
from ..volume.axes import AXES
from .memory_estimate import MemoryEstimate, refuse_too_much
from .quick_estimate import ClassifiedSheets
from .stage_cache import Job

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
        """Make room for what is needed; RleSplatError, with what would fit, where there is not enough."""
        self.job.cache.make_room(needed.needed)
        refuse_too_much(needed)


@dataclass(frozen=True, eq=False)
class Medium:
    """A volume whose voxels are classified and lit, ready to be encoded along a principal axis and splatted.

    Attributes
    ----------
    encode_steps : callable
        ``encode_steps(axis)``: generator of fractions done; returns the tables of a principal axis.
    splat_steps : callable
        ``splat_steps(tables, plane, intervals)``: generator of fractions done (see ``splat.splat.splat_steps``);
        returns an IntermediateImage.
    most_color : callable
        ``most_color(tables)``: the largest channel of any unassociated color that a pixel may have.
    visible_voxels, nan_voxels : int
        Voxels that the tables hold, and voxels that are not numbers.
    estimate : MemoryEstimate or None
        None where nothing is left to be made.
    picture : callable or None
        ``picture(rgba, depth)``: what was warped as a picture, where it is not one yet.
    trace : callable or None
        ``trace(rays, slabs, work)``: color and half depths of single rays (see ``raycast.trace``), where there is a
        way.
    """

    encode_steps: Callable
    splat_steps: Callable
    most_color: Callable
    visible_voxels: int
    nan_voxels: int = 0
    estimate: MemoryEstimate | None = None
    picture: Callable | None = None
    trace: Callable | None = None


@dataclass(frozen=True, eq=False)
class Source(ABC):
    """Where sheets get their voxels from; the base class of all kinds.

    Attributes
    ----------
    scene : Scene
        Without the effects that are off; its volume is the grid that is splatted.
    quality : Quality
        With a backend that is settled.
    """

    scene: Scene
    quality: Quality

    sheets: ClassVar[type[ClassifiedSheets]] = ClassifiedSheets  # what its sheets are made of

    @property
    def machine(self) -> dict:
        """Keyword arguments of every function with kernels."""
        return dict(backend=self.quality.backend, threads=self.quality.threads)

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

    def splat_bytes(self, plane: BasePlane, shortened: bool) -> int:
        """Scratch memory of the splat on to a base plane; ``shortened``: whether rays are shortened."""
        return scratch_bytes(plane, self.scene.volume.shape_xyz, self.quality, self.sheets.scalar_sheets, shortened)

    def tables_held(self, encodings: dict) -> dict:
        """Principal axis -> tables that are held in memory, given those that the picture needs."""
        return encodings

    @abstractmethod
    def medium_steps(self, work: Work):
        """Generator of Progress: the Medium, its tables still to be made.

        Says what memory is about to be taken; raises RleSplatError, with what would fit, when there is not enough.
        """


def array_key(*arrays) -> tuple:
    """The bytes of arrays, as a part of a stage's key."""
    return tuple(np.ascontiguousarray(array).tobytes() for array in arrays)
