"""Save Figure: the volume as a figure for print, with scale bar, color bar and letters, and its sidecar."""

import os
from dataclasses import replace

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, StringProperty

from ..bridge.data.decimals import typed
from ..bridge.data.settings import quality_of, tolerance_of
from ..bridge.live.slices import slice_objects
from ..bridge.loop.jobs import StepwiseOperator
from ..bridge.pictures import figure
from ..bridge.render.output_settings import free_path
from ..bridge.scene import render_scene
from ..bridge.translations import filled
from ..bridge.volumes import volumes
from ..rle_splat.figure.files import sidecar_path
from ..rle_splat.figure.make import figure_steps
from ..rle_splat.figure.plan import AUTO, CENTER, OFF, FigureStyle, Panel
from ..rle_splat.scene import RleSplatError
from .add_names import names_of
from .refusal import has_values
from .through_camera import evaluated

DEFAULT_NAME = "figure", ".svg"


class RLE_SPLAT_OT_save_figure(StepwiseOperator, bpy.types.Operator):
    bl_idname = "rle_splat.save_figure"
    bl_label = "Save Figure"
    bl_description = (
        "Save the volume, without meshes and slices, as a figure for print with scale bar, color bar, letters and "
        "caption (.svg, .png or .exr), and a file beside it from which the same figure can be made again"
    )

    filepath: StringProperty(
        name="File", description="The figure, which ends in .svg, .png or .exr", subtype="FILE_PATH",
        options={"SKIP_SAVE"})  # fmt: skip
    check_existing: BoolProperty(default=True, options={"HIDDEN"})  # the file browser marks the name of a file in red
    filter_glob: StringProperty(default="*.svg;*.png;*.exr", options={"HIDDEN"})
    view: EnumProperty(
        name="View", description="From where the volume is seen",
        items=[("CAMERA", "Camera", "The scene's camera"),
               ("VIEWPORT", "Viewport", "The 3D viewport in use, or the largest one")])  # fmt: skip
    width_cm: FloatProperty(
        name="Width", description="Width of the figure in centimeters", default=17.0, min=1.0, max=200.0
    )
    dpi: FloatProperty(name="Resolution", description="Pixels per inch", default=300.0, min=20.0, max=2400.0)
    font_size: FloatProperty(
        name="Font Size", description="Size of the lettering in points", default=8.0, min=3.0, max=72.0
    )
    background: EnumProperty(
        name="Background", description="Color of the page",
        items=[("white", "White", "White page, black lettering"), ("black", "Black", "Black page, white lettering"),
               ("transparent", "Transparent", "No background, black lettering")])  # fmt: skip
    title: StringProperty(name="Title", description="Text above the picture")
    use_caption: BoolProperty(name="Caption", description="Write below the pictures what is seen", default=True)
    caption: StringProperty(
        name="Caption Text", description="Text of the caption. Empty describes the transfer function and the view"
    )
    scale_bar: BoolProperty(name="Scale Bar", description="Show a scale bar", default=True)
    scale_length: FloatProperty(
        name="Length", description="Length of the scale bar in millimeters; 0 chooses a round one", min=0.0
    )
    scale_depth: EnumProperty(
        name="In Perspective", description="Where the scale bar is true in perspective, in which lengths differ with "
        "depth; written beside the bar",
        items=[("NONE", "No Bar", "Show no scale bar in perspective"),
               ("CENTER", "At the Volume's Middle", "The scale bar is true at the distance of the volume's "
                "middle")])  # fmt: skip
    color_bar: BoolProperty(name="Color Bar", description="Show colors and opacity over the values", default=True)
    names: BoolProperty(
        name="Names", description="Write the names of the segments that are shown, and of named structures, beside the "
        "volume, with lines to them")  # fmt: skip
    sides: EnumProperty(
        name="Letters", description="How the patient's sides are shown",
        items=[("auto", "Automatic", "Letters, where the file says where the sides are"),
               ("letters", "Letters", "Letters at the edges of the picture"), ("cube", "Cube", "A cube with letters"),
               ("off", "Off", "Nothing")])  # fmt: skip
    compare: StringProperty(
        name="Presets Side by Side", description="Names of presets, separated by commas, such as ct-bone, ct-skin; "
        "each in a picture of its own. Empty uses the volume's transfer function")  # fmt: skip

    is_new = False  # only files are written
    _viewport_has_depth = False  # whether the view of the button is a perspective one

    poll = classmethod(has_values)

    def invoke(self, context, _event):
        self.is_confirmed = True
        view = context.region_data
        self._viewport_has_depth = view is not None and view.is_perspective
        if not self.filepath:
            self.filepath = free_path(*DEFAULT_NAME, figure.is_free)
        if context.scene.camera is None:
            self.view = "VIEWPORT"
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def draw(self, context):
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        if slice_objects(context.scene):
            layout.label(text="Slices are not in figures", icon="INFO")
        for name in ("view", "width_cm", "dpi", "font_size", "background", "sides"):
            layout.prop(self, name)
        layout.prop(self, "scale_bar")
        if self.scale_bar:
            layout.prop(self, "scale_length")
            layout.prop(self, "scale_depth")
            if self.scale_depth == "NONE" and self._is_perspective(context):
                layout.label(text="No scale bar in perspective: set In Perspective", icon="INFO")
        layout.prop(self, "color_bar")
        layout.prop(self, "names")
        layout.prop(self, "use_caption")
        if self.use_caption:
            layout.prop(self, "caption")
        layout.prop(self, "compare")
        if not self.compare:
            layout.prop(self, "title")

    def _is_perspective(self, context) -> bool:
        """Whether lengths of the figure's view differ with depth."""
        if self.view == "CAMERA":
            camera = context.scene.camera
            return camera is not None and camera.type == "CAMERA" and camera.data.type == "PERSP"
        return self._viewport_has_depth

    def prepare(self, context):
        if tolerance_of(context.scene) is not None:
            raise RleSplatError(
                "A figure cannot be made with a Maximum Error; turn it off in Advanced, then save again."
            )
        if not self.filepath:
            raise RleSplatError("The figure has no file; give a path that ends in .svg, .png or .exr.")
        self._path = figure.absolute(self.filepath)
        figure.check_files(self._path, self.was_in_window)
        owner = volumes.volume_object(context)
        depsgraph = evaluated(context, owner)
        plain = self._read_scene(context, owner, depsgraph)
        self._sources = figure.sources_of(owner, depsgraph, self._path)
        presets = tuple(name.strip() for name in self.compare.split(",") if name.strip())
        panels = figure.compared(plain, presets, owner, depsgraph) or (Panel(plain, self.title),)
        if self.names:
            panels = tuple(replace(one, names=names_of(owner, context.scene)) for one in panels)
        wanted = figure.figure_of(panels, self._style())
        return figure_steps(wanted, [quality_of(context.scene)] * len(wanted.panels), render_scene.KEPT)

    def _read_scene(self, context, owner, depsgraph):
        """The scene as the figure sees it: the volume alone, without meshes."""

        def warn(sentence):
            self.report({"WARNING"}, sentence)

        if self.view == "CAMERA":
            return render_scene.read_scene(owner, depsgraph, with_meshes=False, warn=warn)[0]
        render_scene.check_kept_up(owner, depsgraph)
        return render_scene.seen_by(owner, depsgraph, figure.viewport_camera(context, owner), warn=warn)

    def _style(self) -> FigureStyle:
        length = typed(self.scale_length) or AUTO
        return FigureStyle(
            width_cm=typed(self.width_cm), dpi=typed(self.dpi), font_size=typed(self.font_size),
            background=self.background, sides=self.sides, color_bar=self.color_bar,
            caption=(self.caption or None) if self.use_caption else "", scale_bar=length if self.scale_bar else OFF,
            scale_depth=None if self.scale_depth == "NONE" else CENTER,
        )  # fmt: skip

    def commit(self, _context, made):
        try:
            sidecar = figure.write(self._path, made, self._sources)
        except (OSError, RuntimeError) as problem:  # Blender raises the latter for an .exr
            reason = getattr(problem, "strerror", None) or str(problem).strip().rstrip(".")
            raise RleSplatError(f"Cannot write {self._path}: {reason}; choose another place.") from None
        if sidecar["missing"]:
            names = ", ".join(sidecar["missing"]).replace("_", " ")
            said = filled("The figure cannot be made again from the file beside it, which lacks: {names}.", names=names)
            self.report({"WARNING"}, said)
        page, sentences = made.page, " ".join(made.remarks)
        size = f"{page.width} x {page.height} pixels"
        files = f"{os.path.basename(self._path)} ({size}) and {sidecar_path(self._path).name}"
        self.report({"INFO"}, f"Saved {files}. {sentences}".rstrip())
