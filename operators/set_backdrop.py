"""Camera Backdrop: the volume's picture in the active camera's view, behind or in front of the objects."""

import bpy
from bpy.props import BoolProperty, EnumProperty

from ..bridge import backdrop, following, pictures, render_scene, volumes
from ..bridge.canvas import Canvas
from ..bridge.jobs import StepwiseOperator
from ..bridge.settings import tolerance_of
from .through_camera import has_volume_and_camera, report_picture


class RLE_SPLAT_OT_set_backdrop(StepwiseOperator, bpy.types.Operator):
    bl_idname = "rle_splat.set_backdrop"
    bl_label = "Camera Backdrop"
    bl_description = "Splat the volume and show it in the active camera's view, matched to the pixel"
    bl_options = {"REGISTER", "UNDO"}

    place: EnumProperty(
        name="Place", description="Where the camera shows the picture",
        items=[("BACK", "Behind", "Behind the scene's objects"),
               ("FRONT", "In Front", "In front of them, cut off where a mesh hides the volume"),
               ("SCENE", "As Set", "As set in the panel")],
        default="SCENE", options={"SKIP_SAVE"})
    follow: BoolProperty(
        name="Follow Camera", description="Splat anew whenever the frame changes", options={"SKIP_SAVE"})

    @classmethod
    def poll(cls, context):
        return has_volume_and_camera(cls, context)

    def prepare(self, context):
        following.stop()
        settings = context.scene.rle_splat
        self._place = settings.backdrop_depth if self.place == "SCENE" else self.place
        self._follow = self.follow if self.properties.is_property_set("follow") else settings.backdrop_follows
        volume_object = volumes.volume_object(context)
        self._name, self._camera_name = volume_object.name, context.scene.camera.name
        plain, quality = render_scene.read_scene(
            volume_object, context.evaluated_depsgraph_get(),
            with_meshes=self._place == "FRONT" and settings.meshes_occlude,
            warn=lambda sentence: self.report({"WARNING"}, sentence))
        self._canvas, self._earlier = Canvas(self._name, "backdrop"), backdrop.state(context.scene.camera.data)
        tolerance = tolerance_of(context.scene)
        return render_scene.steps(plain, quality, tolerance=tolerance, previews=self.wants_previews)

    def show_preview(self, context, preview):
        camera = render_scene.still_there(self._camera_name)
        backdrop.show(camera.data, self._canvas.show(preview.rendering.rgba), self._place)

    def put_back(self, context):
        camera = bpy.data.objects.get((self._camera_name, None))
        if camera is not None:
            backdrop.restore(camera.data, self._earlier)
        self._canvas.put_back()

    def commit(self, context, rendering):
        volume_object = render_scene.still_there(self._name)
        camera = render_scene.still_there(self._camera_name)
        settings = context.scene.rle_splat
        image, depth_image = pictures.keep(volume_object, rendering.rgba, rendering.depth, kind="backdrop")
        settings.image, settings.depth_image = image, depth_image
        settings.backdrop_object, settings.backdrop_depth = volume_object, self._place
        settings.backdrop_follows = self._follow
        pictures.note_report(settings, rendering.report)
        backdrop.show(camera.data, image, self._place)
        report_picture(self, image, rendering)


class RLE_SPLAT_OT_remove_backdrop(bpy.types.Operator):
    bl_idname = "rle_splat.remove_backdrop"
    bl_label = "Remove Backdrop"
    bl_description = "Take the volume's picture out of the active camera's view"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        camera = context.scene.camera
        if camera is None or camera.type != "CAMERA" or backdrop.find(camera.data) is None:
            cls.poll_message_set("The active camera has no backdrop of a volume")
            return False
        return True

    def execute(self, context):
        following.stop()
        backdrop.hide(context.scene.camera.data)
        context.scene.rle_splat.backdrop_object = None
        return {"FINISHED"}


CLASSES = (RLE_SPLAT_OT_set_backdrop, RLE_SPLAT_OT_remove_backdrop)
