"""Source of a ``.rle`` file or folder: voxels that are classified, lit and encoded already."""

from __future__ import annotations

from dataclasses import dataclass

from ..classify.classification import opacity_distance, unit_length
from ..classify.transfer_function import TransferFunction
from ..scene import RleSplatError
from ..volume.axes import AXIS_NAMES
from .medium import ClassifiedVoxels
from .source import Source, Work

CLASSIFIED_ALREADY = "A .rle file holds voxels that are classified already, so they are splatted as they are: pre."


@dataclass(frozen=True, eq=False)
class FileSource(Source):
    """The tables of a ``.rle`` file, whose classification, colors and model are what they are.

    It is the ``voxels`` of its medium, too: its tables are read, and not made.
    """

    nan_voxels = 0
    estimate = None

    @property
    def axes(self):
        return self.scene.volume.principal_axes

    @property
    def remarks(self) -> tuple[str, ...]:
        return (*super().remarks, CLASSIFIED_ALREADY)

    def refuse_without(self, axis: int) -> None:
        """RleSplatError if there are no tables of a principal axis."""
        if axis not in self.scene.volume.principal_axes:
            raise RleSplatError(
                f"This view needs principal axis {AXIS_NAMES[axis]}, which the .rle file does not hold; "
                "encode the volume again with all three axes."
            )

    @property
    def visible_voxels(self) -> int:
        return self.scene.volume.visible_voxels

    def classify_steps(self, work: Work):
        """Generator of nothing: the file as it is; RleSplatError where it holds another model."""
        stored = self.scene.volume
        if self.quality.model != stored.model:
            raise RleSplatError(
                f"This .rle file holds the {stored.model} model; render it with that one, or encode it again."
            )
        yield from ()
        return self

    def shade_steps(self, voxels: FileSource, work: Work):
        """Generator of nothing: the ClassifiedVoxels of the file, which are lit already."""
        yield from ()
        stored = self.scene.volume
        length = unit_length(stored, self.scene.index_to_world)
        if stored.model == "opacity":
            length = opacity_distance(stored, TransferFunction.from_json(stored.transfer_function), length)
        else:
            length /= stored.unit_length
        return ClassifiedVoxels(voxels, self.quality, self.scene.mist, length)

    def encode_steps(self, axis: int):
        """Generator of fractions done: the tables of a principal axis; RleSplatError where the file has none."""
        self.refuse_without(axis)
        return (yield from self.scene.volume.tables_steps(axis))[0]
