"""Composite into Render: every render, still or animation, gets the volume splatted anew and laid over it."""

import bpy

from ..bridge import compositor, images, versions, volumes
from ..bridge.camera import read_camera
from ..bridge.transfer import read_transfer
from ..rle_splat.scene import RleSplatError
from .refusal import refuse
from .through_camera import has_volume_and_camera

LONGEST_NAME = 30  # characters of the object's name that an image's name keeps; Blender 4.5 cuts names at 63


class RLE_SPLAT_OT_composite(bpy.types.Operator):
    bl_idname = "rle_splat.composite"
    bl_label = "Composite into Render"
    bl_description = "Lay the volume over every render of this scene, with the meshes standing inside it"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        return has_volume_and_camera(cls, context)

    def execute(self, context):
        scene = context.scene
        volume_object = volumes.volume_object(context)
        try:
            depsgraph = context.evaluated_depsgraph_get()
            _camera, width, height = read_camera(depsgraph)
            volumes.load_volume(volume_object, lambda sentence: self.report({"WARNING"}, sentence))
            read_transfer(volume_object, depsgraph)
            versions.check_compositor_can_run(scene)
            compositor.check_editable(scene)
        except RleSplatError as problem:
            return refuse(self, problem)

        def make_image(earlier, layer):
            if earlier is not None:
                compositor.fit(earlier, width, height)
            parts = [volume_object.name[:LONGEST_NAME], "Splat Composite", layer]
            image = images.ensure_image(earlier, " ".join(filter(None, parts)), width, height)
            images.clear(image)
            images.pack(image)  # blank: what a saved file holds of it, see over_render.py
            return image

        settings = scene.rle_splat
        settings.composite_image = None
        remarks = compositor.insert(scene, make_image)
        settings.composite_object, settings.composite_image = volume_object, compositor.images_of(scene)[0]
        settings.use_composite = True
        settings.message = settings.render_problem = settings.failed_frames = ""
        others = [o.name for o in volumes.volume_objects(scene) if o != volume_object and not o.hide_render]
        if others:
            remarks.append(f"Only {volume_object.name} is composited; not {', '.join(others)}.")
        self.report({"INFO"}, " ".join([f"{volume_object.name} is laid over every render from now on.", *remarks]))
        return {"FINISHED"}


class RLE_SPLAT_OT_remove_composite(bpy.types.Operator):
    bl_idname = "rle_splat.remove_composite"
    bl_label = "Remove from Render"
    bl_description = "Take the volume out of the compositor and leave everything else there as it is"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        if not (context.scene.rle_splat.use_composite or compositor.is_inserted(context.scene)):
            cls.poll_message_set("No volume is composited into the render")
            return False
        return True

    def execute(self, context):
        settings = context.scene.rle_splat
        settings.use_composite = False
        settings.composite_object = settings.composite_image = None
        settings.message = settings.render_problem = settings.failed_frames = ""
        made = compositor.images_of(context.scene)
        compositor.remove(context.scene)
        for image in made:
            compositor.drop(image)
        return {"FINISHED"}


CLASSES = (RLE_SPLAT_OT_composite, RLE_SPLAT_OT_remove_composite)
