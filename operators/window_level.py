"""Window and Level: set the range of values, by a preset or by numbers."""

import bpy
from bpy.app.translations import pgettext_tip
from bpy.props import BoolProperty, EnumProperty, FloatProperty

from ..bridge.live import slice_window
from ..bridge.look import transfer
from ..bridge.translations import OURS, filled
from ..bridge.volumes import volumes
from ..rle_splat.read.dicom.suv import UNIT as SUV
from .refusal import has_editable_transfer

# Common windows: label, level, window and unit.
WINDOWS = {
    "CT_BONE": ("Bone Window", 500.0, 2000.0, "HU"),
    "CT_SOFT_TISSUE": ("Soft Tissue Window", 50.0, 400.0, "HU"),
    "CT_MEDIASTINUM": ("Mediastinum Window", 50.0, 350.0, "HU"),
    "CT_LIVER": ("Liver Window", 60.0, 160.0, "HU"),
    "CT_BRAIN": ("Brain Window", 40.0, 80.0, "HU"),
    "CT_LUNG": ("Lung Window", -600.0, 1500.0, "HU"),
    "CT_ANGIOGRAPHY": ("Vessel Window", 300.0, 600.0, "HU"),
    **{f"PET_SUV_{high}": (f"SUV 0–{high}", 0.5 * high, float(high), SUV) for high in (5, 7, 10, 15)},
}
ITEMS = [
    ("CUSTOM", "As Below", "Use the window and level below"),
    ("DATA", "All Values", "Span the smallest to the largest value of the volume"),
] + [
    (name, label, f"Level {level:g} {unit}, window {width:g} {unit}")
    for name, (label, level, width, unit) in WINDOWS.items()
]
OF_VALUES = "mip", "minip", "average"  # modes whose grays are values
KEEPING = "Span the smallest to the largest value of the volume, and redraw the curves so that the picture stays"


def windows_of(properties, of_slices: bool) -> list[str]:
    """The common windows in the unit of a volume; windows of tissues are for gray values, not for colors."""
    shows_values = of_slices or (properties.use_grays and properties.mode in OF_VALUES)
    return [name for name, (*_, unit) in WINDOWS.items()
            if unit == properties.value_unit and (shows_values or unit != "HU")]  # fmt: skip


class RLE_SPLAT_OT_window_level(bpy.types.Operator):
    """Set window and level: the range of values that colors and opacity, or the slices, cover"""

    bl_idname = "rle_splat.window_level"
    bl_label = "Window and Level"
    bl_options = {"REGISTER", "UNDO"}

    preset: EnumProperty(name="Common Window", description="Window for a tissue, or over all values", items=ITEMS)
    center: FloatProperty(name="Level", description="Value at the center of the range", translation_context=OURS)
    width: FloatProperty(name="Window", description="Width of the range of values", default=1.0, min=1e-6)
    keep_values: BoolProperty(
        name="Keep Colors", description="Redraw the curves so that every value keeps its color and opacity, and only "
        "the range that the panel shows changes", default=False)  # fmt: skip
    of_slices: BoolProperty(
        name="Of Slices", description="Set the range that the volume's slices show from black to white", default=False
    )

    poll = classmethod(has_editable_transfer)

    @classmethod
    def description(cls, _context, properties):
        if properties.keep_values:
            return pgettext_tip(KEEPING)
        items = (text for name, _label, text in ITEMS[1:] if name == properties.preset)
        return pgettext_tip(next(items, cls.bl_description))

    def invoke(self, context, _event):
        properties = volumes.volume_object(context).rle_splat
        if not self.properties.is_property_set("center"):
            self.center, self.width = slice_window.level_and_window(properties, self.of_slices)
        return self.execute(context)

    def execute(self, context):
        owner = volumes.volume_object(context)
        properties = owner.rle_splat
        if self.preset == "DATA":
            low, high = properties.value_low, properties.value_high
            self.center, self.width = 0.5 * (low + high), max(high - low, 1e-6)
        elif self.preset != "CUSTOM":
            _, self.center, self.width, unit = WINDOWS[self.preset]
            if properties.value_unit != unit:
                self.report({"WARNING"}, filled(
                    "The values of this volume are not in {unit}, so this window may show nothing; choose All Values.",
                    unit=unit))  # fmt: skip
        if self.of_slices:
            slice_window.move(properties, self.center, self.width)
            return {"FINISHED"}
        remark = transfer.move_window(owner, self.center, self.width, self.keep_values)
        if remark:
            self.report({"WARNING"}, remark)
        return {"FINISHED"}
