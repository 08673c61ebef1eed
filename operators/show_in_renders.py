"""Show in Renders and Remove from Renders: add the volume to every render through the compositor."""

import bpy

from ..bridge import versions
from ..bridge.data import preferences
from ..bridge.look.transfer import read_transfer
from ..bridge.pictures import images, pictures
from ..bridge.render import compositor, mesh_shadows
from ..bridge.scene import world_render
from ..bridge.scene.camera import read_camera
from ..bridge.translations import filled
from ..bridge.volumes import volumes
from .reading import LoadsFirst
from .refusal import needs, refuses
from .through_camera import has_volume_and_camera


class RLE_SPLAT_OT_show_in_renders(LoadsFirst, bpy.types.Operator):
    bl_idname = "rle_splat.show_in_renders"
    bl_label = "Show in Renders"
    bl_description = (
        "Include this scene's volumes in every render (F12), with meshes in front of, inside and behind them, by nodes "
        "of the compositor. Turns on Lock Interface"
    )
    bl_options = {"REGISTER", "UNDO"}

    poll = classmethod(has_volume_and_camera)

    @refuses
    def execute(self, context):
        scene = context.scene
        volume_object = volumes.volume_object(context)
        depsgraph = context.evaluated_depsgraph_get()
        world_render.make_ready(scene, depsgraph)
        _camera, width, height = read_camera(depsgraph)
        volumes.load_volume(volume_object, lambda sentence: self.report({"WARNING"}, sentence))
        read_transfer(volume_object, depsgraph)
        versions.check_compositor_can_run(scene)
        compositor.check_editable(scene)

        def make_image(earlier, layer):
            parts = [volume_object.name[: pictures.LONGEST_NAME], pictures.SUFFIXES["composite"], layer]
            own = earlier if pictures.owned_by(earlier, scene) else None
            image = images.ensure_image(own, " ".join(filter(None, parts)), width, height)
            pictures.own(image, scene)
            images.clear(image)
            return image

        settings = scene.rle_splat
        settings.composite_image = None
        remarks = compositor.insert(scene, make_image)
        settings.composite_object, settings.composite_image = volume_object, compositor.images_of(scene)[0]
        settings.use_composite = True
        if not settings.is_property_set("on_failed_frame"):
            settings.on_failed_frame = preferences.value("failed_frame")
        settings.message = settings.render_problem = settings.failed_frames = ""
        settings.deleted_volume = volume_object.name
        mesh_shadows.settle(scene)
        others = [o.name for o in volumes.volume_objects(scene) if o != volume_object and not o.hide_render]
        if others:
            remarks.append(filled(
                "Also included: {volumes}. To leave a volume out, hide it from renders in the Outliner.",
                volumes=", ".join(others)))  # fmt: skip
        included = filled("{volume} is now included in every render.", volume=volume_object.name)
        self.report({"INFO"}, " ".join([included, *remarks]))
        return {"FINISHED"}


class RLE_SPLAT_OT_remove_from_renders(bpy.types.Operator):
    bl_idname = "rle_splat.remove_from_renders"
    bl_label = "Remove from Renders"
    bl_description = "Leave volumes out of renders. Removes their nodes from the compositor; other nodes stay"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        is_shown = context.scene.rle_splat.use_composite or compositor.is_inserted(context.scene)
        return needs(cls, is_shown, "Renders include no volume")

    def execute(self, context):
        settings = context.scene.rle_splat
        settings.use_composite = False
        settings.composite_object = settings.composite_image = None
        settings.message = settings.render_problem = settings.failed_frames = ""
        made = compositor.images_of(context.scene)
        compositor.remove(context.scene)
        for image in made:
            compositor.drop(image)
        mesh_shadows.settle(context.scene)
        return {"FINISHED"}
