"""What operators share that render through the active camera: ``poll``, reading the scene, and the report."""

from bpy.props import BoolProperty

from ..bridge.held import Held
from ..bridge.look import transfer
from ..bridge.loop.jobs import StepwiseOperator
from ..bridge.scene import render_scene, viewports, world_render
from ..bridge.translations import filled
from ..bridge.volumes import volumes
from .refusal import has_values, has_volume, needs


def has_volume_and_camera(cls, context) -> bool:
    """For ``poll``: whether there is a volume and a camera; otherwise the button's tooltip says what is missing."""
    return has_volume(cls, context) and needs(
        cls, context.scene.camera is not None,
        "The scene has no active camera; add one and make it active with Ctrl+Numpad 0")  # fmt: skip


def has_values_and_camera(cls, context) -> bool:
    """For ``poll``: as ``has_volume_and_camera``, and the volume has values."""
    return has_volume_and_camera(cls, context) and has_values(cls, context)


class ThroughCamera(StepwiseOperator):
    """Base class of operators that make images of the volume as the active camera sees it."""

    use_meshes: BoolProperty(
        name="Meshes Hide Volume",
        options={"SKIP_SAVE"},
        description="Let meshes hide the volume behind them and cast shadows on it. If unset, the scene's setting is "
        "used",
    )

    poll = classmethod(has_volume_and_camera)

    def read_scene(self, context):
        """Return (Scene, Quality), and remember Blender's scene and volume for ``commit``."""
        volume_object = volumes.volume_object(context)
        own = self.properties.is_property_set("use_meshes")
        self.with_meshes = self.use_meshes if own else context.scene.rle_splat.meshes_occlude
        self._scene, self._volume = Held(context.scene), Held(volume_object)
        return render_scene.read_scene(
            volume_object, evaluated(context, volume_object), with_meshes=self.with_meshes,
            warn=lambda sentence: self.report({"WARNING"}, sentence))  # fmt: skip


def evaluated(context, volume_object):
    """The evaluated depsgraph, including edits of the transfer function that a script made."""
    transfer.evaluate_anew(volume_object)
    world_render.make_ready(context.scene, context.evaluated_depsgraph_get())
    return context.evaluated_depsgraph_get()


def look_through_camera(context) -> None:
    """Switch a 3D view to the camera unless one shows it already: the view in use, else the largest."""
    areas = viewports.areas_of(context.window)
    if not areas or is_looked_through(context):
        return
    area = context.area if context.area in areas else max(areas, key=lambda one: one.width * one.height)
    area.spaces.active.region_3d.view_perspective = "CAMERA"


def is_looked_through(context) -> bool:
    """Whether a 3D view of the window looks through the active camera."""
    return any(area.spaces.active.region_3d.view_perspective == "CAMERA" for area in viewports.areas_of(context.window))


def report_picture(operator, image, rendering) -> None:
    """Report the image's name, size and remarks; a blank picture is reported as a warning."""
    sentences = " ".join(rendering.report["remarks"])
    if rendering.rgba[..., 3].any():
        height, width = rendering.depth.shape
        said = filled("{image}: {width} x {height} pixels.", image=image.name, width=width, height=height)
        operator.report({"INFO"}, f"{said} {sentences}".rstrip())
    else:
        operator.report({"WARNING"}, sentences or "The picture is blank; the volume is hidden or transparent here.")
