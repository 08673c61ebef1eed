"""What the tab shows before the first volume: three steps with their buttons, and whether the first picture waits."""

from ..bridge.translations import with_ellipsis
from ..rle_splat.runtime.jit import nothing_compiled_yet
from .places import paragraph


def draw(context, layout) -> None:
    """Draw the hint."""
    step = _step(context, layout, "1. Import a volume, or drop its file into the 3D viewport")
    step.operator("rle_splat.import_volume", text=with_ellipsis("Import Volume"), icon="IMPORT")
    step.operator("rle_splat.import_dicom_series", text=with_ellipsis("Import DICOM Series"), icon="FILE_FOLDER")
    step = _step(context, layout, "2. Choose a preset, then frame the volume")
    row = step.row()
    row.enabled = False  # as the buttons are, until there is a volume
    row.menu("RLE_SPLAT_MT_presets", icon="PRESET")
    step.operator("rle_splat.frame_volume", icon="ZOOM_SELECTED")
    step = _step(context, layout, "3. Show it in renders (F12) with the rest of the scene")
    step.operator("rle_splat.show_in_renders", icon="RESTRICT_RENDER_OFF")
    if nothing_compiled_yet():
        sentence = "The first picture takes longer, since code is compiled for this computer"
        paragraph(context, layout, sentence, icon="TIME")


def _step(context, layout, text: str):
    """A box with the step's sentence; returns the column for its buttons."""
    box = layout.box()
    paragraph(context, box, text)
    return box.column(align=True)
