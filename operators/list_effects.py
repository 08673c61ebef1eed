"""List Effects: show which effects the scene needs now, and why, without making a picture."""

import bpy

from ..bridge.data import effects
from ..bridge.data.settings import tolerance_of
from ..bridge.pictures import outdated
from ..bridge.render import mesh_shadows
from ..bridge.scene import render_scene
from ..bridge.volumes import volumes
from ..rle_splat.accuracy.planner.tolerance import without_shadows_of
from ..rle_splat.effects.analyze import analyze
from .refusal import refuses
from .through_camera import has_volume_and_camera


class RLE_SPLAT_OT_list_effects(bpy.types.Operator):
    bl_idname = "rle_splat.list_effects"
    bl_label = "List Effects"
    bl_description = "Show which effects the scene needs now, and why, without making a picture"
    bl_options = {"REGISTER", "UNDO"}

    poll = classmethod(has_volume_and_camera)

    @refuses
    def execute(self, context):
        settings = context.scene.rle_splat
        owner, depsgraph = volumes.volume_object(context), context.evaluated_depsgraph_get()
        plain, quality = render_scene.read_scene(
            owner,
            depsgraph,
            with_meshes=settings.meshes_occlude,
            warn=lambda sentence: self.report({"WARNING"}, sentence),
        )
        if tolerance_of(context.scene) is not None:
            plain, _ = without_shadows_of(plain, quality)
        found = analyze(plain, quality)
        listed = [{"name": effect.name, "on": effect.on, "reason": effect.reason} for effect in found]
        listed.append(mesh_shadows.row(*mesh_shadows.why(owner, depsgraph, plain), ms=None))
        effects.note_effects(settings, listed, "For the scene as it is now; not rendered yet.")
        outdated.update_status(context.scene, context.evaluated_depsgraph_get())  # the file may have been read again
        names = [entry["name"] for entry in listed if entry["on"]]
        self.report({"INFO"}, f"Effects in use: {', '.join(names) or 'none'}.")
        return {"FINISHED"}
