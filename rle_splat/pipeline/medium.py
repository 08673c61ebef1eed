"""The mediums: what the voxels of a volume have become once they are classified and lit.

There are two, with the same methods.  ``ClassifiedVoxels`` are classified before they are splatted, as in the paper;
``ScalarVoxels`` hold the scalar, which is interpolated inside each sheet and then classified.  Where their tables come
from (a scan, or a ``.rle`` file) is a matter of their ``voxels``.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass

from ..classify.lookup_table import LookupTable
from ..effects.ray_values import ValueMap
from ..runtime.steps import announce
from ..scene import Mist, Quality
from ..splat.scalar_splat import LabelLook, scalar_splat_steps, value_splat_steps
from ..splat.splat import splat_steps


@dataclass(frozen=True, eq=False)
class Medium(ABC):
    """A volume that is ready to be encoded along a principal axis and splatted; the base class of both kinds.

    Attributes
    ----------
    voxels : LitVolume, LitScalars or FileSource
        What is encoded, or read: it has ``encode_steps(axis)``, ``visible_voxels``, ``nan_voxels`` and ``estimate``.
    mist : Mist or None
        What the colors fade to.
    """

    voxels: object
    quality: Quality
    mist: Mist | None

    @property
    def visible_voxels(self) -> int:
        """Voxels that the tables hold."""
        return self.voxels.visible_voxels

    @property
    def nan_voxels(self) -> int:
        """Voxels that are not numbers."""
        return self.voxels.nan_voxels

    @property
    def estimate(self):
        """The MemoryEstimate of all that is made; None where nothing is left to be made."""
        return self.voxels.estimate

    def encode_steps(self, axes):
        """Generator of Progress: encode along some principal axes; returns axis -> tables."""
        tables = {}
        for axis in axes:
            tables[axis] = yield from announce(self.voxels.encode_steps(axis), 0.1, 0.2, "Encoding")
        return tables

    @abstractmethod
    def splat_steps(self, tables, plane, intervals):
        """Generator of fractions done (see ``splat.splat.splat_steps``); returns the IntermediateImage of a base plane.

        ``intervals``: where its rays begin and end, or None for whole rays.
        """

    @abstractmethod
    def most_color(self, tables) -> float:
        """The largest channel of any unassociated color that a pixel may have; ``tables``: of all principal axes."""

    def trace(self, rays, slabs: int):
        """Color, half depths and work of single rays (see ``raycast.trace``), where the source has any."""
        return self.voxels.trace(rays, slabs)

    def finish(self, rgba, depth):
        """The picture and its depth, from what the warp returns."""
        return rgba, depth


@dataclass(frozen=True, eq=False)
class ClassifiedVoxels(Medium):
    """Voxels that are classified and lit before they are splatted.

    ``length_unit``: world length in which the lengths of rays are counted.
    """

    length_unit: float

    def splat_steps(self, tables, plane, intervals):
        return splat_steps(tables, plane, self.quality, self.length_unit, intervals, self.mist)

    def most_color(self, tables) -> float:
        return max((*(each.most_color for each in tables), *mist_color(self.mist)))


@dataclass(frozen=True, eq=False)
class ScalarVoxels(Medium):
    """Voxels whose scalars are interpolated, and classified where they are interpolated.

    Attributes
    ----------
    transfer : LookupTable or ValueMap
        The lookup table of the transfer function; in a mode that shows values, how these are counted.
    brightest : float
        The largest channel that a pixel's unassociated color may have.
    absorbs : bool
        Whether the volume absorbs light only, as in an X-ray picture.
    further : tuple of LookupTable
        Those of further channels.
    labels : LabelLook or None
        Whose tables classify in place of ``transfer``.
    """

    transfer: LookupTable | ValueMap
    brightest: float
    absorbs: bool = False
    further: tuple[LookupTable, ...] = ()
    labels: LabelLook | None = None

    @property
    def shows_values(self) -> bool:
        """Whether a pixel shows a value of its ray in place of emission and absorption."""
        return isinstance(self.transfer, ValueMap)

    def splat_steps(self, tables, plane, intervals):
        if self.shows_values:
            return value_splat_steps(tables, self.transfer, plane, self.quality, intervals)
        return scalar_splat_steps(
            tables, self.transfer, plane, self.quality, intervals, self.absorbs, self.mist, self.further,
            self.labels,
        )  # fmt: skip

    def most_color(self, tables) -> float:
        return self.brightest

    def finish(self, rgba, depth):
        return self.transfer.picture(rgba, depth) if self.shows_values else (rgba, depth)


def mist_color(mist: Mist | None) -> tuple:
    """The color that all others fade to; black where there is no mist."""
    return mist.color if mist else (0.0,)
