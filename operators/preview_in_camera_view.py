"""Preview in and Remove from Camera View: the volume's picture as a background image of the active camera."""

import bpy
from bpy.props import BoolProperty, EnumProperty

from ..bridge.data.settings import tolerance_of
from ..bridge.held import Held
from ..bridge.loop import work
from ..bridge.loop.jobs import StepwiseOperator
from ..bridge.pictures import backdrop, outdated, pictures
from ..bridge.pictures.canvas import ProgressImage, redraw
from ..bridge.scene import render_scene
from ..bridge.volumes import volumes
from .refusal import needs
from .through_camera import evaluated, has_volume_and_camera, is_looked_through, look_through_camera, report_picture


class RLE_SPLAT_OT_preview_in_camera_view(StepwiseOperator, bpy.types.Operator):
    bl_idname = "rle_splat.preview_in_camera_view"
    bl_label = "Preview in Camera View"
    bl_description = (
        "Show a picture of the volume in the active camera's view, aligned to the pixel. Renders do not include it"
    )

    place: EnumProperty(
        name="Preview Position", description="Whether the camera view shows the picture behind or in front of the "
        "objects", items=[*backdrop.PLACES, ("SCENE", "As Set", "Use the setting in the panel")],
        default="SCENE", options={"SKIP_SAVE"})  # fmt: skip
    follow: BoolProperty(
        name="Keep Up to Date", description="Update the picture when the frame, the camera, the volume, a light, a "
        "cutting object or a setting changes. If unset, the panel's setting is used",
        options={"SKIP_SAVE"})  # fmt: skip

    poll = classmethod(has_volume_and_camera)

    def invoke(self, context, event):
        look_through_camera(context)
        return super().invoke(context, event)

    def prepare(self, context):
        work.drop(work.BACKDROP)
        scene = context.scene
        settings, camera, volume_object = scene.rle_splat, scene.camera, volumes.volume_object(context)
        self._place = settings.backdrop_depth if self.place == "SCENE" else self.place
        self._follow = self.follow if self.properties.is_property_set("follow") else settings.backdrop_follows
        self._scene, self._volume, self._camera = Held(scene), Held(volume_object), Held(camera)
        with_meshes = self._place == "FRONT" and settings.meshes_occlude
        plain, quality = render_scene.read_scene(
            volume_object, evaluated(context, volume_object), with_meshes=with_meshes,
            warn=lambda sentence: self.report({"WARNING"}, sentence))  # fmt: skip
        self._canvas = ProgressImage(self._scene, self._volume, "backdrop", self._camera)
        entry = backdrop.find(scene, camera)
        self._shown = None if entry is None else Held(entry.image)
        self._shows_images = camera.data.show_background_images
        tolerance = tolerance_of(scene)
        self._made_from = outdated.made_of(plain, quality, tolerance, with_meshes)
        return render_scene.steps(plain, quality, tolerance=tolerance, drafts=self.was_in_window)

    def show_draft(self, context, rendering):
        image, camera = self._canvas.show(rendering.rgba), self._camera.get()
        entry = backdrop.find(self._scene.get(), camera)
        if entry is None:
            backdrop.show(camera, image, self._place)
        else:
            entry.image = image

    def put_back(self, context):
        scene, camera = self._scene.find(), self._camera.find()
        entry = None if scene is None or camera is None else backdrop.find(scene, camera)
        if entry is not None and self._shown is not None:
            entry.image = self._shown.find()
        elif entry is not None:
            backdrop.hide(scene, camera)
            camera.data.show_background_images = self._shows_images
        self._canvas.put_back()

    def commit(self, context, rendering):
        scene, volume_object, camera = self._scene.get(), self._volume.get(), self._camera.get()
        self.is_new = self._shown is None
        image, depth_image = pictures.keep(
            scene, volume_object, rendering.rgba, rendering.depth, kind="backdrop", camera=camera
        )
        settings = scene.rle_splat
        settings.image, settings.depth_image = image, depth_image
        settings.backdrop_object, settings.backdrop_depth = volume_object, self._place
        settings.backdrop_follows = self._follow
        settings.message = ""
        outdated.note(image, self._made_from)
        pictures.note_report(settings, rendering.report)
        backdrop.show(camera, image, self._place)
        report_picture(self, image, rendering)
        if not is_looked_through(context):
            self.report({"INFO"}, "No 3D viewport looks through the camera; press Numpad 0 in one to see the picture.")


class RLE_SPLAT_OT_remove_from_camera_view(bpy.types.Operator):
    bl_idname = "rle_splat.remove_from_camera_view"
    bl_label = "Remove from Camera View"
    bl_description = "Remove the volume's picture from the active camera's view"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        camera = context.scene.camera
        is_shown = camera is not None and camera.type == "CAMERA" and backdrop.find(context.scene, camera) is not None
        return needs(cls, is_shown, "The active camera shows no picture of a volume")

    def execute(self, context):
        work.drop(work.BACKDROP)
        backdrop.hide(context.scene, context.scene.camera)
        context.scene.rle_splat.backdrop_object = None
        redraw(context)
        return {"FINISHED"}
