"""The paper's own method as one of the systems: run-length-encoded sheet-buffer splatting.

Zhang, Sun and Sun, Accelerate volume splatting by using run length encoding, ICCS 2003.
"""

from ..encode.encode import encode
from ..encode.tables import RunLengthVolume
from ..pipeline.render import render
from ..scene import Quality
from .medium import ShadedScene
from .system import ReadySystem


def encode_axes(medium: ShadedScene, quality: Quality) -> dict[int, RunLengthVolume]:
    """Encode the run-length tables of the principal axes that the view needs."""
    return {
        axis: encode(medium.classified, medium.colors, axis, quality.model, threads=quality.threads)
        for axis in medium.principal_axes
    }


def prepare(medium: ShadedScene, quality: Quality) -> ReadySystem:
    """The renderer at ``quality``, from tables made in advance."""
    return prepare_tables(medium, quality, encode_axes(medium, quality))


def prepare_tables(medium: ShadedScene, quality: Quality, axes: dict[int, RunLengthVolume], **notes) -> ReadySystem:
    """The renderer at ``quality`` from given tables, ``axes``: principal axis -> RunLengthVolume."""
    scene = medium.stored(axes)
    memory: dict = {}
    for encoded in axes.values():
        for table, size in encoded.table_bytes.items():
            memory[table] = memory.get(table, 0) + size
    return ReadySystem(lambda: render(scene, quality), memory, notes)


def prepare_paper(medium: ShadedScene, quality: Quality) -> ReadySystem:
    """The paper's pipeline to the letter: opacities added in slice-plane sheets, one sheet pixel per voxel."""
    return prepare(medium, Quality.paper(threads=quality.threads))
