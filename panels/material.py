"""The Material panel: how the surfaces in a volume reflect light."""

import bpy

from ..bridge.data.automatic import draw_length
from ..bridge.data.settings import is_pre_classified
from ..bridge.volumes import encoded, volumes
from ..rle_splat.shade.surface_normals import automatic_sigma
from .places import DataTab, OfVolume


class MaterialPanel:
    """Draws the panel in Lighting and in the object data properties."""

    bl_label = "Material"

    def draw(self, context):
        layout = self.layout
        layout.use_property_split = True
        owner = volumes.volume_object(context)
        properties = owner.rle_splat
        layout.enabled = not encoded.is_of(owner)  # whose voxels are lit already
        layout.prop(properties, "use_shading")
        column = layout.column()
        column.enabled = properties.use_shading and not is_pre_classified(context.scene.rle_splat)
        automatic = automatic_sigma(properties.found_spacing)
        draw_length(column, properties, "smoothness", "use_automatic_smoothness", "Smoothness", automatic)
        column = layout.column(align=True)
        column.enabled = properties.use_shading
        for name in ("ambient", "diffuse", "specular", "shininess", "two_sided"):
            column.prop(properties, name)


class RLE_SPLAT_PT_material(MaterialPanel, OfVolume, bpy.types.Panel):
    bl_parent_id = "RLE_SPLAT_PT_shading"


class RLE_SPLAT_PT_data_material(MaterialPanel, DataTab, bpy.types.Panel):
    bl_order = 3
    bl_options = {"DEFAULT_CLOSED"}
