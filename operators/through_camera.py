"""What the operators that look through the scene's camera share: when they can, what they read, what they say."""

from bpy.props import BoolProperty

from ..bridge import render_scene, volumes
from ..bridge.jobs import StepwiseOperator
from .refusal import has_volume


class ThroughCamera(StepwiseOperator):
    """Makes images of what the active camera sees of the volume, among meshes or alone."""

    bl_options = {"REGISTER", "UNDO"}

    use_meshes: BoolProperty(
        name="Meshes Occlude", options={"SKIP_SAVE"},
        description="Stop each ray at the first mesh surface, and let meshes cast shadows on the volume; otherwise the "
        "volume is there alone. Left unset, the scene's own Meshes Occlude holds")

    @classmethod
    def poll(cls, context):
        return has_volume_and_camera(cls, context)

    def read_scene(self, context):
        """(Scene, Quality), see ``render_scene.read_scene``; the volume's name is kept in ``_name``."""
        volume_object = volumes.volume_object(context)
        self._name = volume_object.name
        own = self.properties.is_property_set("use_meshes")
        return render_scene.read_scene(
            volume_object, context.evaluated_depsgraph_get(),
            with_meshes=self.use_meshes if own else context.scene.rle_splat.meshes_occlude,
            warn=lambda sentence: self.report({"WARNING"}, sentence))


def has_volume_and_camera(cls, context) -> bool:
    """For ``poll``: whether there is a volume and a camera; the button's tooltip says what is missing."""
    if not has_volume(cls, context):
        return False
    if context.scene.camera is None:
        cls.poll_message_set("The scene has no active camera; add one and make it active with Ctrl+Numpad 0")
        return False
    return True


def report_picture(operator, image, rendering) -> None:
    """Say what was made and what is odd about it; a blank picture is a warning."""
    sentences = " ".join(rendering.report["remarks"])
    if rendering.rgba[..., 3].any():
        height, width = rendering.depth.shape
        operator.report({"INFO"}, f"{image.name}: {width} x {height} pixels. {sentences}".rstrip())
    else:
        operator.report({"WARNING"}, sentences or "The picture is blank: the volume is hidden or transparent here.")
