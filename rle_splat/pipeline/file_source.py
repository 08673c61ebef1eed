"""Source of a ``.rle`` file or folder: voxels that are classified, lit and encoded already."""

from __future__ import annotations

from dataclasses import dataclass

from ..classify.classification import opacity_distance, unit_length
from ..classify.transfer_function import TransferFunction
from ..scene import RleSplatError
from ..volume.axes import AXIS_NAMES
from .scan_source import classified_sheets
from .source import Source, Work

CLASSIFIED_ALREADY = "A .rle file holds voxels that are classified already, so they are splatted as they are: pre."


@dataclass(frozen=True, eq=False)
class FileSource(Source):
    """The tables of a ``.rle`` file, whose classification, colors and model are what they are."""

    @property
    def axes(self):
        return self.scene.volume.principal_axes

    @property
    def remarks(self) -> tuple[str, ...]:
        return (*super().remarks, CLASSIFIED_ALREADY)

    def tables_held(self, encodings: dict) -> dict:
        return self.scene.volume.held(encodings)

    def refuse_without(self, axis: int) -> None:
        """RleSplatError if there are no tables of a principal axis."""
        if axis not in self.scene.volume.principal_axes:
            raise RleSplatError(
                f"This view needs principal axis {AXIS_NAMES[axis]}, which the .rle file does not hold; "
                "encode the volume again with all three axes."
            )

    def medium_steps(self, work: Work):
        stored = self.scene.volume
        if self.quality.model != stored.model:
            raise RleSplatError(
                f"This .rle file holds the {stored.model} model; render it with --model {stored.model}, or encode it "
                "again."
            )
        yield from ()

        def encode_steps(axis: int):
            self.refuse_without(axis)
            return (yield from stored.tables_steps(axis))[0]

        length = unit_length(stored, self.scene.index_to_world)
        if stored.model == "opacity":
            length = opacity_distance(stored, TransferFunction.from_json(stored.transfer_function), length)
        else:
            length /= stored.unit_length
        counts = stored.visible_voxels
        return classified_sheets(encode_steps, length, self.quality, self.scene.mist, counts)
