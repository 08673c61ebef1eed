"""Extract Surface: the boundary of what is opaque, as a mesh with the volume's colors."""

from dataclasses import replace

import bpy
import numpy as np
from bpy.props import EnumProperty, FloatProperty

from ..bridge.data.settings import scene_scale_of
from ..bridge.held import Held
from ..bridge.look import transfer
from ..bridge.loop.jobs import StepwiseOperator
from ..bridge.scene.clip_objects import read_clips
from ..bridge.translations import with_unit
from ..bridge.volumes import surface_mesh, volumes
from ..bridge.volumes.labels import read_labels
from ..rle_splat.classify.surface import Solid, largest_opacity
from ..rle_splat.classify.transfer_function import TransferFunction
from ..rle_splat.effects.clips import half_spaces
from ..rle_splat.scene import RleSplatError
from .placing import make_active
from .refusal import has_values
from .through_camera import evaluated

OPACITY, VALUE = "OPACITY", "VALUE"


class RLE_SPLAT_OT_extract_surface(StepwiseOperator, bpy.types.Operator):
    """Add a mesh of the volume's surface, where its opacity or its value passes a limit, in its colors. Cutting
    objects cut it, and hidden segments are left out"""

    bl_idname = "rle_splat.extract_surface"
    bl_label = "Extract Surface"
    bl_options = {"UNDO"}  # without REGISTER: Adjust Last Operation (F9) would make it again
    is_new = False  # Blender pushes the undo step, for UNDO is among ``bl_options``

    of: EnumProperty(
        name="Surface Of",
        description="What the surface is the boundary of",
        items=[
            (OPACITY, "Opacity", "Surface at which the opacity passes a limit"),
            (VALUE, "Value", "Surface at which the value passes a limit"),
        ],
    )
    opacity: FloatProperty(
        name="Opacity", description="Opacity at the surface, as a share of the largest one of the transfer function",
        default=0.5, min=0.001, max=1.0, subtype="FACTOR")  # fmt: skip
    value: FloatProperty(name="Value", description="Value of the volume at the surface", default=300.0)

    unit = ""  # in the labels of the dialog

    poll = classmethod(has_values)

    def draw(self, _context):
        layout = self.layout
        layout.use_property_split = True
        layout.prop(self, "of")
        if self.of == OPACITY:
            layout.prop(self, "opacity")
        else:
            layout.prop(self, "value", text=with_unit("Value", self.unit), translate=False)

    def invoke(self, context, _event):
        self.is_confirmed, self.unit = True, volumes.volume_object(context).rle_splat.value_unit
        return context.window_manager.invoke_props_dialog(self)

    def prepare(self, context):
        owner, scene = volumes.volume_object(context), context.scene
        depsgraph = evaluated(context, owner)
        volume = volumes.load_volume(owner, lambda sentence: self.report({"WARNING"}, sentence), depsgraph)
        if not volume.holds_values:
            raise RleSplatError(
                f"The file of {owner.name!r} holds classified voxels, which have no surface; import the scan itself."
            )
        function = transfer.read_transfer(owner, depsgraph)
        labels = read_labels(owner, depsgraph, volume, function)
        scale = scene_scale_of(scene, volume.unit)
        self._matrix = np.diag((scale, scale, scale, 1.0)) @ volume.affine
        to_world = np.array(owner.evaluated_get(depsgraph).matrix_world, np.float64) @ self._matrix
        kept = tuple((half_spaces(clip, to_world), clip.kind == "box" and clip.keep == "outside")
                     for clip in read_clips(depsgraph, owner))  # fmt: skip
        self._owner = Held(owner)
        if self.of == VALUE:
            function, threshold = _step_at(function, self.value), 0.5
            if labels is not None:
                steps = {key: one and _step_at(one, self.value) for key, one in labels.functions.items()}
                labels = replace(labels, functions=steps)
        else:
            threshold = self.opacity * largest_opacity(function, labels)
            if threshold == 0.0:
                raise RleSplatError(f"All of {owner.name!r} is transparent; choose a preset.")
        return surface_mesh.surface_steps(Solid(volume, function, threshold, kept, labels))

    def commit(self, context, surface):
        one = surface_mesh.add_surface(context, self._owner.get(), surface, self._matrix)
        context.view_layer.update()
        if one.name in context.view_layer.objects:
            make_active(self, context, one, "was added")
        self.report({"INFO"}, f"{one.name}: {len(one.data.vertices)} vertices and {len(one.data.polygons)} faces.")


def _step_at(function: TransferFunction, value: float) -> TransferFunction:
    """The colors of a transfer function, transparent below a value and opaque from there on."""
    return TransferFunction(
        name=function.name, unit=function.unit, opacity=((value, 0.0), (value, 1.0)), color=function.color
    )
