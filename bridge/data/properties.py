"""The properties saved in the .blend: the settings of a scene, and the registration of the volume's and its own."""

import os
from functools import partial

import bpy

from ...rle_splat import scene as tables
from .. import messages
from ..loop import index
from ..pictures import backdrop
from ..pictures.pictures import PictureProperties
from ..scene import viewports
from ..translations import OURS
from ..volumes import box
from ..volumes.channels import ChannelProperties
from ..volumes.labels import LabelProperties
from . import knob_items
from .accuracy import AccuracyRowProperties
from .automatic import switch
from .effects import EffectOverrideProperties, EffectRowProperties
from .overridable import (
    BoolProperty,
    CollectionProperty,
    EnumProperty,
    FloatProperty,
    LiveBool,
    LiveEnum,
    LiveFloat,
    LiveInt,
    LivePointer,
    PointerProperty,
    StringProperty,
    evaluate_anew,
)  # fmt: skip
from .preferences import FAILED_FRAME_ITEMS
from .settings import removed_sentence, scene_scale_of, suit_classification, suit_knobs
from .volume_properties import VolumeProperties

QUALITY_TEXTS = {
    "draft": ("Draft", "Fast and coarse, as the drafts that viewports show while anything changes"),
    "standard": ("Standard", "A balance of time and accuracy"),
    "fine": ("Fine", "More accurate, for final pictures; up to about three times the time of Standard"),
    "strict": (
        "Very Fine",
        "The most accurate; 3 to 10 times the time of Standard. With shadows or ambient occlusion, the first picture "
        "in a light can take 50 times as long",
    ),
}
CLASSIFICATION_TEXTS = {
    "pre": ("Colors", "Give every voxel its color and opacity, then interpolate those, as in the original 2003 method "
            "(pre-classification)"),
    "post": ("Values", "Interpolate the values, then look up color and opacity, as ray casting does "
             "(post-classification)"),
}  # fmt: skip
# The numbers are those of saved files, where 1 was an item that was removed (see settings.REMOVED_NUMBERS).
CLASSIFICATION_ITEMS = [
    (name, *CLASSIFICATION_TEXTS[name], "", number) for name, number in zip(tables.CLASSIFICATIONS, (0, 2), strict=True)
]
QUALITY_ITEMS = [(name, *texts) for name, texts in QUALITY_TEXTS.items()] + [
    ("paper", "Original 2003 Method", "The algorithm exactly as published in 2003, for comparison"),
    ("custom", "Custom", "Set every option in the Advanced panel"),
]


def _knob_chosen(settings, context):
    suit_classification(settings)
    evaluate_anew(settings, context)


def _classification_chosen(settings, context):
    suit_knobs(settings)
    evaluate_anew(settings, context)


# For knobs with values that some classifications do not support.
KnobEnum = partial(EnumProperty, update=_knob_chosen)
USUAL = tables.Quality()  # the default values of the knobs


PLAIN_TEXTS = {
    "classification": "Whether values become opacity and color before or after they are interpolated",
    "depth_rule": "How many layers are computed between neighboring slices, and how they are added up along the view: "
    "evenly, by Simpson's or Gauss's rule, or exactly (pre-integrated), which needs Interpolate: Values. Choose more "
    "for steep surfaces with stripes, fewer for speed",
    "sheet_density": "Pixels of a layer per pixel of the picture; 0 is one per voxel. Raise it for hard edges once "
    "more Layers do not help, lower it for speed",
    "kernel": "Shape in which a voxel is drawn. With Interpolate: Values it is always Linear",
    "minification": "What prevents shimmer where voxels are smaller than pixels. With Interpolate: Values it is "
    "always Off. Choose Widen if the volume shimmers in animations",
    "warp_filter": "How the finished layers become the pixels of the picture",
    "axis_fade": "Degrees over which two stacks of layers are blended as the camera turns, so that the picture does "
    "not jump; only in orthographic views",
    "termination": "Stop adding layers to a pixel once less than this share of the light behind them still passes: "
    "0.001 is a thousandth (early ray termination). Leave it as it is, or lower it if other errors are smaller",
    "rays": "Compute pixels that differ from a neighbor by at least this much exactly, by ray casting; slower. 1 is "
    "from black to white, 0 is off. Needs Interpolate: Values",
    "model": "What is added up where voxels overlap. With Interpolate: Values it is always Extinction",
    "record": "Bytes in memory for each voxel; fewer lose accuracy",
}


def _rescale_boxes(settings, context):
    evaluate_anew(settings, context)
    for volume_object in settings.id_data.objects:
        if volume_object.rle_splat.is_volume:
            box.rescale_box(volume_object, scene_scale_of(settings.id_data, volume_object.rle_splat.length_unit))


def _redraw(_settings, _context):
    for area in viewports.all_areas():
        area.tag_redraw()


def _place_backdrop(settings, context):
    """Move an existing backdrop behind or in front of the objects at once."""
    scene = settings.id_data
    entry = backdrop.find(scene, scene.camera) if scene.camera is not None and scene.camera.type == "CAMERA" else None
    if entry is not None:
        entry.display_depth = settings.backdrop_depth
    evaluate_anew(settings, context)


def _removed(name: str, usual) -> property:
    """A property of earlier versions, without effect: a script reads its usual value; one that sets it gets a sentence
    and goes on."""
    return property(lambda group: usual, lambda group, _value: messages.complain(group, removed_sentence(name)))


def _of_all_volumes(name: str) -> property:
    """A property that each volume has, as earlier versions had it for a scene: that of its first volume, and a script
    that sets it sets it for all."""

    def first(settings):
        found = index.objects(index.of(settings.id_data).volumes)
        return getattr(found[0].rle_splat, name) if found else VolumeProperties.bl_rna.properties[name].default

    def put(settings, value) -> None:
        for one in index.objects(index.of(settings.id_data).volumes):
            setattr(one.rle_splat, name, value)

    return property(first, put)


class SceneSettings(bpy.types.PropertyGroup):
    """The settings of a scene's pictures, and the report of the last one."""

    scene_scale: FloatProperty(
        name="Scene Scale", description="Blender units per millimeter. 0.001 is true scale where a unit is one meter",
        default=0.001, min=1e-9, soft_max=1.0, precision=6, update=_rescale_boxes)  # fmt: skip
    quality: KnobEnum(
        name="Quality", description="Balance of accuracy and time", items=QUALITY_ITEMS, default=USUAL.name,
        translation_context=OURS)  # fmt: skip
    max_error: LiveFloat(
        name="Maximum Error (8-Bit Steps)", default=0.0, min=0.0, soft_max=16.0, precision=2,
        description="Largest allowed error in red, green, blue or alpha of any pixel, in 8-bit steps, of which 255 "
        "lead from black to white. The picture's error is measured and reported")  # fmt: skip
    use_max_error: BoolProperty(
        name="Maximum Error", description="Use the fastest settings expected to stay below a maximum error, "
        "instead of Quality",
        **switch("max_error", 0.0, 2.0, when_special=False))  # fmt: skip
    classification: EnumProperty(
        name="Interpolate", description=PLAIN_TEXTS["classification"], items=CLASSIFICATION_ITEMS,
        default=USUAL.classification, update=_classification_chosen)  # fmt: skip
    depth_rule: KnobEnum(
        name="Layers", description=PLAIN_TEXTS["depth_rule"], default=USUAL.depth_rule,
        items=knob_items.items((*tables.DEPTH_RULES, *tables.SCALAR_DEPTH_RULES), later=("midpoint-3",)))  # fmt: skip
    kernel: KnobEnum(
        name="Voxel Shape", description=PLAIN_TEXTS["kernel"], items=knob_items.items(tables.FOOTPRINTS),
        default=USUAL.kernel)  # fmt: skip
    minification: KnobEnum(
        name="Small Voxels", description=PLAIN_TEXTS["minification"], items=knob_items.items(tables.MINIFICATIONS),
        default=USUAL.minification)  # fmt: skip
    warp_filter: LiveEnum(
        name="Pixel Filter", description=PLAIN_TEXTS["warp_filter"], items=knob_items.items(tables.WARP_FILTERS),
        default=USUAL.warp_filter)  # fmt: skip
    model: KnobEnum(
        name="Overlap", description=PLAIN_TEXTS["model"], items=knob_items.items(tables.MODELS), default=USUAL.model
    )
    record: KnobEnum(
        name="Voxel Memory", description=PLAIN_TEXTS["record"], items=knob_items.RECORD_ITEMS, default=str(USUAL.record)
    )
    sheet_density: LiveFloat(
        name="Pixel Density", description=PLAIN_TEXTS["sheet_density"], default=USUAL.sheet_density, min=0.0,
        max=tables.MOST_SHEET_DENSITY)  # fmt: skip
    termination: LiveFloat(
        name="Stop Below", description=PLAIN_TEXTS["termination"], default=USUAL.termination, min=0.0, max=0.499,
        precision=5)  # fmt: skip
    axis_fade: LiveFloat(
        name="Blend Angle (°)", description=PLAIN_TEXTS["axis_fade"], default=USUAL.axis_fade, min=0.0,
        max=tables.MOST_FADE)  # fmt: skip
    rays: LiveFloat(
        name="Exact Pixels", description=PLAIN_TEXTS["rays"], default=USUAL.rays, min=0.0, soft_max=1.0, precision=3
    )
    threads: LiveInt(
        name="Threads", description="Number of threads that make this scene's pictures", default=0, min=0, soft_max=64
    )
    use_all_cores: BoolProperty(
        name="All Cores", description="Use as many threads as the processor has cores",
        **switch("threads", 0, os.cpu_count() or 1))  # fmt: skip
    mode, use_grays, display, lighting = map(_of_all_volumes, ("mode", "use_grays", "display", "lighting"))
    use_shadows: LiveBool(
        name="Shadows",
        default=True,
        description="Let the volume and meshes cast shadows on the volume. Only lights whose own Shadow option is on "
        "cast them",
    )
    use_world: LiveBool(
        name="World Light",
        default=True,
        description="Light the volume from all sides with the world: its color, its environment image or any nodes. A "
        "world of one color lights it only if the scene has a light",
    )
    world_light: StringProperty(
        name="Rendered World Light", description="Light of the world as it was last rendered", options={"HIDDEN"}
    )
    use_mist: LiveBool(
        name="Mist",
        default=False,
        description="Fade the volume toward the world's color with distance, by the Mist settings of the world. The "
        "Mist pass of a view layer has no effect on the volume",
    )
    ambient_occlusion: LiveFloat(
        name="Ambient Occlusion", default=0.0, min=0.0, max=1.0, precision=2,
        description="Darken Ambient and World Light where the volume or a mesh blocks them, as in hollows; 1 is full "
        "strength")  # fmt: skip
    indirect_light: LiveFloat(
        name="Scattering", default=0.0, min=0.0, max=1.0, precision=2,
        description="Scatter the light of scene lights that cast shadows, so that skin, fat and thin parts are "
        "translucent; 1 is full strength")  # fmt: skip
    clip_objects: LivePointer(
        name="Cutting Objects",
        type=bpy.types.Collection,
        description="Collection of objects that cut the volume. Meshes and cube Empties cut as boxes, flat meshes and "
        "arrow Empties as planes. The part that all of them keep is shown",
    )
    use_clips: LiveBool(
        name="Cut Volumes", default=True, description="Apply the cutting objects. Turn this off to see whole volumes"
    )
    show_scale_bar: BoolProperty(
        name="Scale Bar", default=False, update=_redraw,
        description="Show a scale bar in 3D viewports. In perspective, it is true at the depth of the volume's "
        "middle. Renders do not show it: use Add Letters and Scale Bar")  # fmt: skip
    show_color_bar: BoolProperty(
        name="Color Bar", default=False, update=_redraw,
        description="Show the volume's colors with their values in 3D viewports. Renders do not show it: use Save "
        "Figure")  # fmt: skip
    meshes_occlude: LiveBool(
        name="Meshes Hide Volume", default=True,
        description="Let meshes hide the part of the volume behind them, also inside the volume")  # fmt: skip
    antialias: LiveBool(
        name="Anti-Aliasing", default=False,
        description="Render without steps at the edges of the volume: the mean of four pictures, shifted by parts of a "
        "pixel. Takes up to five times as long. Viewports do not show it")  # fmt: skip
    backdrop_depth: EnumProperty(
        name="Preview Position", description="Whether the camera view shows the picture behind or in front of the "
        "objects", update=_place_backdrop,
        items=backdrop.PLACES)  # fmt: skip
    backdrop_object: PointerProperty(
        name="Volume in Camera View", type=bpy.types.Object, description="Volume that the camera view shows"
    )
    backdrop_follows: BoolProperty(
        name="Keep Up to Date", default=False, update=evaluate_anew,
        description="Update the picture when the frame, the camera, the volume, a light, a cutting object or a "
        "setting changes")  # fmt: skip
    composite_object: PointerProperty(
        name="Volume in Renders", type=bpy.types.Object, description="Volume that renders include"
    )
    deleted_volume: StringProperty(
        name="Deleted Volume", options={"HIDDEN"},
        description="Name of the volume in renders, for messages once it is deleted")  # fmt: skip
    composite_image: PointerProperty(
        name="Picture in Renders", type=bpy.types.Image, description="Picture of the volume in renders"
    )
    use_previews, backend = _removed("use_previews", True), _removed("backend", "auto")
    message: StringProperty(name="Message", description="Problem of the last render or frame change")
    render_problem: StringProperty(
        name="Problem of the Render", description="First problem of the last render, with the frames that failed"
    )
    failed_frames: StringProperty(
        name="Failed Frames", description="Frames of the last render that could not be drawn, such as 2, 5-7"
    )
    on_failed_frame: EnumProperty(
        name="If a Frame Fails", description="What happens if the volume cannot be drawn in a rendered frame",
        items=FAILED_FRAME_ITEMS)  # fmt: skip
    use_composite: BoolProperty(
        name="Show in Renders", description="Include this scene's volumes in every render", default=False
    )
    scene_id: StringProperty(
        name="Id", description="Id of this scene, stored in the images of its pictures", options={"HIDDEN"}
    )
    pictures: CollectionProperty(type=PictureProperties, name="Pictures", description="Pictures of this scene")
    image: PointerProperty(name="Picture", type=bpy.types.Image, description="The last picture")
    depth_image: PointerProperty(name="Depth", type=bpy.types.Image, description="Depth of the last picture")
    last_report: StringProperty(name="Report", description="Report of the last picture, one fact per line")
    last_report_json: StringProperty(name="Report as JSON", description="Report of the last picture as JSON")
    effect_overrides: PointerProperty(
        type=EffectOverrideProperties, name="Effects by Hand", description="Effects that are forced on or off"
    )
    effect_rows: CollectionProperty(type=EffectRowProperties, name="Effects", description="State of each effect")
    effects_note: StringProperty(name="Note on Effects", description="What the list of effects describes")
    accuracy_rows: CollectionProperty(
        type=AccuracyRowProperties, name="Measured Settings", description="Measured times and errors of settings"
    )
    accuracy_note: StringProperty(name="Measurement", description="Volume, camera and size of the measurement")
    error_image: PointerProperty(name="Error Map", type=bpy.types.Image, description="The last error map")
    error_note: StringProperty(name="Errors", description="Summary of the last error map")


CLASSES = (
    EffectOverrideProperties, EffectRowProperties, AccuracyRowProperties, PictureProperties, LabelProperties,
    ChannelProperties, VolumeProperties, SceneSettings,
)  # fmt: skip


def register():
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    bpy.types.Object.rle_splat = PointerProperty(type=VolumeProperties)
    bpy.types.Scene.rle_splat = PointerProperty(type=SceneSettings)


def unregister():
    del bpy.types.Scene.rle_splat
    del bpy.types.Object.rle_splat
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
