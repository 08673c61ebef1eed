"""Export Segments: the label map of a volume with the names and colors of its segments, for other programs."""

import os
from dataclasses import replace

import bpy
from bpy.props import EnumProperty, StringProperty
from bpy_extras.io_utils import ExportHelper

from ..bridge.loop import store
from ..bridge.loop.jobs import READ_BUDGET, StepwiseOperator
from ..bridge.translations import filled
from ..bridge.volumes import labels, loading, segments, volumes
from ..bridge.volumes.source_paths import check_is_no_scan
from ..rle_splat.read.formats import write_steps
from ..rle_splat.runtime.steps import rescale
from ..rle_splat.scene import RleSplatError
from .refusal import has_values, needs

FORMATS = [
    (".nii.gz", "NIfTI", "Label map with a table of names in its header, as TotalSegmentator writes it"),
    (".seg.nrrd", "Slicer Segmentation", "Segmentation of 3D Slicer"),
]


class RLE_SPLAT_OT_export_segments(StepwiseOperator, bpy.types.Operator, ExportHelper):
    """Write the segments with their names and colors to a file for other programs"""

    bl_idname = "rle_splat.export_segments"
    bl_label = "Export Segments"
    bl_options = set()
    is_new = False  # nothing of the .blend changes
    time_budget = READ_BUDGET

    filter_glob: StringProperty(default="*.nii.gz;*.nrrd", options={"HIDDEN"})
    format: EnumProperty(name="Format", description="Format of the file", items=FORMATS)

    @property
    def filename_ext(self) -> str:
        return self.format

    @classmethod
    def poll(cls, context):
        return has_values(cls, context) and needs(
            cls, volumes.volume_object(context).rle_splat.labels, "Make or read segments first"
        )

    def loading(self, context):
        return loading.missing_steps(volumes.volume_object(context), with_labels=True)

    def invoke(self, context, event):
        self.is_confirmed = True
        self.filepath = f"{volumes.volume_object(context).name} segments{self.format}"
        return ExportHelper.invoke(self, context, event)

    def check(self, _context):
        path = _with_suffix(self.filepath, self.format)
        changed, self.filepath = path != self.filepath, path
        return changed

    def prepare(self, context):
        if not self.filepath:
            raise RleSplatError("Give the file to write, such as segments.nii.gz.")
        path = bpy.path.abspath(self.filepath)
        own = [suffix for suffix, *_ in FORMATS if path.lower().endswith(suffix)]
        self._path = path if own and not self.properties.is_property_set("format") else _with_suffix(path, self.format)
        check_is_no_scan(self._path)
        owner = volumes.volume_object(context)
        volume = volumes.load_volume(owner)
        steps = labels.load_steps(store.wish_of(owner, None, labels.PURPOSE), labels.file_of(owner), volume)
        return _export_steps(steps, segments.named_rows(owner), self._path)

    def commit(self, _context, _result):
        self.report({"INFO"}, filled("Wrote {file}.", file=os.path.basename(self._path)))


def _with_suffix(path: str, suffix: str) -> str:
    """A path with the suffix of a format in place of that of another one."""
    for known in (*(one for one, *_ in FORMATS), ".nii", ".nrrd"):
        if path.lower().endswith(known):
            return path[: -len(known)] + suffix
    return path + suffix if os.path.basename(path) else path


def _export_steps(load_steps, names, path: str):
    """Generator of Progress: write a label map, which ``load_steps`` gives, with names."""
    found = (yield from rescale(load_steps, 0.0, 0.3)).volume
    yield from rescale(write_steps(replace(found, named_labels=names), path), 0.3, 1.0)
