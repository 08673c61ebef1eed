"""The menu of the scene's volumes, of which one is chosen, and the ways to import another."""

import bpy

from ..bridge.translations import with_ellipsis
from ..bridge.volumes import volumes


class RLE_SPLAT_MT_volumes(bpy.types.Menu):
    bl_label = "Volumes"

    def draw(self, context):
        layout = self.layout
        for owner in volumes.volume_objects(context.scene):
            layout.operator("rle_splat.choose_object", text=owner.name, icon=icon_of(owner)).name = owner.name
        layout.separator()
        layout.operator("rle_splat.import_volume", text=with_ellipsis("Import Volume"), icon="IMPORT")
        layout.operator("rle_splat.import_dicom_series", text=with_ellipsis("Import DICOM Series"), icon="FILE_FOLDER")


def icon_of(owner) -> str:
    """The outliner's icon for a local, linked or overridden volume; linked ones have disabled buttons."""
    if owner.library is not None:
        return "LIBRARY_DATA_DIRECT"
    return "OUTLINER_OB_VOLUME" if owner.override_library is None else "LIBRARY_DATA_OVERRIDE"
