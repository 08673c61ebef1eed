"""Bake to Cycles Volume: a Volume object with the volume's extinction and color, for renders without this extension."""

from pathlib import Path

import bpy
import numpy as np
from bpy.props import EnumProperty, IntProperty
from bpy_extras.io_utils import ExportHelper

from ..bridge import linked
from ..bridge.render import medium_volumes
from ..bridge.render.medium_volumes import LOOKS
from ..bridge.volumes import volumes
from ..bridge.volumes.source_paths import check_is_no_scan, kept_path
from ..rle_splat.scene import RleSplatError
from ..rle_splat.volume.reduced import factors_of
from .placing import make_active
from .through_camera import ThroughCamera, has_values_and_camera


class RLE_SPLAT_OT_bake_volume(ThroughCamera, bpy.types.Operator, ExportHelper):
    bl_idname = "rle_splat.bake_volume"
    bl_label = "Bake to Cycles Volume"
    bl_description = (
        "Write what the volume shows now to an OpenVDB file, and add a Volume object with a material that shows it in "
        "Cycles, also where this extension is not installed"
    )
    bl_options = {"UNDO"}  # without REGISTER: Adjust Last Operation (F9) would write the file again
    is_new = False  # Blender pushes the undo step, for UNDO is among ``bl_options``

    filename_ext = ".vdb"

    look: EnumProperty(name="Look", description="How the material shows the volume", items=LOOKS)
    side: IntProperty(
        name="Resolution", description="Voxels along the longest side; 0 keeps every voxel", default=0, min=0,
        soft_max=1024)  # fmt: skip

    poll = classmethod(has_values_and_camera)

    def invoke(self, context, event):
        self.is_confirmed = True
        return ExportHelper.invoke(self, context, event)

    def prepare(self, context):
        if not self.filepath:
            raise RleSplatError("Give the file to write, such as volume.vdb.")
        self._path = Path(bpy.path.ensure_ext(bpy.path.abspath(self.filepath), self.filename_ext))
        check_is_no_scan(self._path)
        plain, quality = self.read_scene(context)
        owner = volumes.volume_object(context)
        self._matrix = owner.evaluated_get(context.evaluated_depsgraph_get()).matrix_world.copy()
        # Location, rotation and scale cannot shear: what they leave is in the file.
        location, rotation, scale = self._matrix.decompose()
        self._basis = self._matrix.LocRotScale(location, rotation, scale)
        residual = np.array(self._basis.inverted_safe() @ self._matrix)
        if self.look != LOOKS[0][0]:
            plain = medium_volumes.unlit(plain)
        factors = factors_of(plain.volume, self.side) if self.side else (1, 1, 1)
        return medium_volumes.file_steps(plain, quality, factors, self._path, residual)

    def commit(self, context, visible):
        scene, owner = self._scene.get(), self._volume.get()
        title = f"{owner.name[: medium_volumes.LONGEST_NAME]} Baked"
        is_lit = self.look == LOOKS[0][0]
        make_material = medium_volumes.emitting_material if is_lit else medium_volumes.scattering_material
        one = medium_volumes.new_object(title, make_material(title))
        one.data.filepath = kept_path(str(self._path), bpy.data.filepath)
        linked.put_into_scene(context, one)
        one.matrix_world = self._basis
        context.view_layer.update()
        if one.name in context.view_layer.objects:
            make_active(self, context, one, "was added")
        if scene.rle_splat.use_composite and not owner.hide_render:
            self.report({"WARNING"}, f"Renders now show {owner.name} twice; disable it in renders (Outliner) to show "
                                     f"{one.name} alone.")  # fmt: skip
        else:
            self.report({"INFO"}, f"{one.name} has {visible} voxels, in {self._path.name}.")
