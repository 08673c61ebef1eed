"""The properties saved in the .blend: a property group on each object and one on the scene.

Voxels are not saved; ``VolumeProperties`` holds the file and the options to read them again.  The curve and the colors
of the transfer function are in the node group ``transfer`` (see ``transfer.py``).  Its window is a property of the
object, so that it can be keyframed.
"""

from functools import partial

import bpy

from ..rle_splat import scene as tables
from ..rle_splat.effects.ray_mode import MODE_NAMES
from . import backdrop, box
from .accuracy import AccuracyRowProperties
from .channels import ChannelProperties
from .effects import EffectOverrideProperties, EffectRowProperties
from .labels import LabelProperties
from .overridable import (
    BoolProperty,
    CollectionProperty,
    EnumProperty,
    FloatProperty,
    IntProperty,
    PointerProperty,
    StringProperty,
)
from .pictures import PictureProperties
from .playback import Playback
from .settings import scene_scale_of, suit_classification, suit_knobs
from .source_options import SourceOptions
from .transfer_nodes import is_transfer_tree

QUALITY_TEXTS = {
    "draft": ("Draft", "Fast and coarse, for moving around"),
    "standard": ("Standard", "A balance of time and accuracy"),
    "fine": ("Fine", "More accurate, for final pictures"),
    "strict": ("Strict", "The most accurate quality, and slow"),
}
AIM_TEXT = "Aims at an error of at most {:g} levels of 1/255 at 999 of 1000 pixels of a post-classified picture"
CLASSIFICATION_TEXTS = {
    "pre": ("Pre-Classified", "Give every voxel its color and opacity, then interpolate those, as in the paper. Edges "
                              "are softer. Errors are measured against truth T1"),
    "refined": ("Refined Grid", "As Pre-Classified, on a finer grid of interpolated values. Edges are sharper; it "
                                "needs much more memory. Errors are measured against truth T2"),
    "post": ("Post-Classified", "Interpolate the values, then look up color and opacity. Edges are as sharp as with "
                                "ray casting. Errors are measured against truth T2"),
}
CLASSIFICATION_ITEMS = [(name, *CLASSIFICATION_TEXTS[name]) for name in tables.CLASSIFICATIONS]
QUALITY_ITEMS = [
    (name, QUALITY_TEXTS[name][0], f"{QUALITY_TEXTS[name][1]}. {AIM_TEXT.format(aim)}")
    for name, aim in tables.PRESET_AIMS.items()
] + [
    ("paper", "Paper", "The algorithm exactly as published, for comparison"),
    ("custom", "Custom", "Set every option in the Advanced panel"),
]
RECORD_ITEMS = [(str(size), f"{size} Bytes", "") for size in tables.RECORDS]
REFINEMENT_ITEMS = [(str(times), f"{times} Times", "") for times in tables.REFINEMENTS]
MODE_ITEMS = [
    (name, MODE_NAMES[name] if name != "composite" else "Composite", text[0].upper() + text[1:])
    for name, text in tables.MODE_TEXTS.items()
]
LIGHTING_ITEMS = [
    ("SCENE", "Scene Lights", "Use the lights of the scene, or a headlight if there are none"),
    ("HEADLIGHT", "Headlight", "Use one white parallel light that shines along the camera's axis"),
    ("NONE", "Unlit", "Show the colors of the transfer function without lights"),
]
CLIP_ITEMS = [
    ("INSIDE", "Inside", "Keep what is inside the box, or behind the plane. The arrow points to what is removed"),
    ("OUTSIDE", "Outside", "Keep what is outside the box, or in front of the plane"),
]


def _evaluate_anew(group, _context):
    """Tag the datablock for an update: Blender does so for a user's edit of these properties, not for a script's."""
    group.id_data.update_tag()


def _knob_chosen(settings, context):
    suit_classification(settings)
    _evaluate_anew(settings, context)


def _classification_chosen(settings, context):
    suit_knobs(settings)
    _evaluate_anew(settings, context)


# Property kinds for the inputs of a picture.
LiveBool, LiveEnum, LiveFloat, LiveInt, LivePointer, LiveString = (
    partial(kind, update=_evaluate_anew)
    for kind in (BoolProperty, EnumProperty, FloatProperty, IntProperty, PointerProperty, StringProperty)
)


# For knobs with values that some classifications do not support.
KnobEnum = partial(EnumProperty, update=_knob_chosen)
USUAL = tables.Quality()  # the default values of the knobs


def _knob(name: str) -> str:
    text = tables.KNOB_TEXTS[name]
    return text[0].upper() + text[1:]


def _items(names):
    return [(name, name.replace("_", " ").title(), "") for name in names]


class VolumeProperties(SourceOptions, Playback, bpy.types.PropertyGroup):
    """The source, facts, transfer function and shading of one volume object."""

    is_volume: BoolProperty(
        name="Is a Volume", description="This object is a volume of RLE Splat", default=False, options={"HIDDEN"})
    filepath: StringProperty(
        name="File", description="File of the volume, relative to the .blend if possible", subtype="FILE_PATH",
        options={"PATH_SUPPORTS_BLEND_RELATIVE"})
    data_key: StringProperty(name="Data Hash", description="Hash of the voxels at the import")
    files_digest: StringProperty(
        name="Files Hash", description="Hash of the names, sizes and times of the volume's files at the import")
    facts: StringProperty(name="Facts", description="Facts about the volume, one per line")
    remarks: StringProperty(name="Remarks", description="Remarks on unusual data, one sentence per line")
    histogram: StringProperty(name="Histogram", description="Histogram of the values as JSON")
    space: StringProperty(
        name="Space", description="\"patient\" if the file says where the patient's left, front and head are")
    length_unit: StringProperty(name="Length Unit", description="Unit of length of the file", default="mm")
    value_low: FloatProperty(name="Smallest Value", description="Smallest physical value of the volume")
    value_high: FloatProperty(name="Largest Value", description="Largest physical value of the volume", default=1.0)

    label_file: LiveString(
        name="Labels", description="Label file: a volume of whole numbers on the same grid, such as a segmentation. "
        "If a label has its own transfer function or color, the volume is drawn pre-classified",
        subtype="FILE_PATH", options={"PATH_SUPPORTS_BLEND_RELATIVE"})
    labels: CollectionProperty(type=LabelProperties, name="Labels", description="Visibility and color of each label")
    smooth_labels: LiveBool(
        name="Smooth Edges", description="Smooth the edges of labels instead of showing the steps of their voxels",
        default=True)
    channels: CollectionProperty(
        type=ChannelProperties, name="Channels", description="Volumes on the same grid that are added to the picture")
    clip_keep: LiveEnum(
        name="Keep", description="Part of the volume that this clip object keeps", items=CLIP_ITEMS)
    clip_only_parent: LiveBool(
        name="Only Its Volume", default=False,
        description="Cut only the volume that this clip object is a child of, not the others in the scene")
    is_slice: BoolProperty(
        name="Is a Slice", description="This mesh shows a slice of the volume that it is a child of", default=False,
        options={"HIDDEN"})
    slice_image: PointerProperty(name="Slice", type=bpy.types.Image, description="The image that this slice shows")
    transfer: LivePointer(
        name="Transfer Function", type=bpy.types.NodeTree, poll=lambda self, tree: is_transfer_tree(tree),
        description="Colors and opacity curve, stored in a node group. Copies of the object share it")
    transfer_name: LiveString(name="Preset", description="Name of the transfer function last applied")
    transfer_unit: LiveString(name="Unit", description="Unit of the transfer function's values")
    window_center: LiveFloat(
        name="Level", description="Value at the center of the colors and the opacity curve", default=0.5, precision=2)
    window_width: LiveFloat(
        name="Window", description="Width of the range of values that the colors and the opacity curve cover",
        default=1.0, min=1e-6, precision=2)
    opacity_scale: LiveFloat(
        name="Opacity", description="Factor on the whole opacity curve", default=1.0, min=0.0, soft_max=2.0)
    opacity_unit_distance: LiveFloat(
        name="Opacity Distance", description="Thickness of material that has the opacity of the curve; 0 uses the "
        "smallest voxel spacing", default=0.0, min=0.0, precision=4)
    use_shading: LiveBool(
        name="Shading", description="Light the volume like a surface where its values change", default=True)
    ambient: LiveFloat(
        name="Ambient", default=0.2, min=0.0, soft_max=1.0, description="Brightness that does not depend on the lights")
    diffuse: LiveFloat(
        name="Diffuse", default=0.8, min=0.0, soft_max=1.0, description="Brightness of surfaces that face a light")
    use_gradient_opacity: LiveBool(
        name="Surfaces Only", default=False,
        description="Make regions of nearly constant values transparent, so that surfaces remain")
    gradient_low: LiveFloat(
        name="Gradient From", default=0.0, min=0.0, soft_max=1000.0, precision=2,
        description="Change of the values per unit of length, such as HU per mm, below which everything is transparent")
    gradient_high: LiveFloat(
        name="To", default=100.0, min=0.0, soft_max=1000.0, precision=2,
        description="Change of the values per unit of length above which the opacity curve is used unchanged")
    specular: LiveFloat(
        name="Specular", default=0.2, min=0.0, soft_max=1.0, description="Brightness of the white highlights")
    shininess: LiveFloat(
        name="Shininess", default=20.0, min=1.0, soft_max=100.0,
        description="Sharpness of the highlights; higher is smaller and sharper")
    highlight: LiveEnum(
        name="Highlight", description="Formula of the highlights", default="BLINN_PHONG",
        items=(("BLINN_PHONG", "Blinn-Phong", "Use the direction halfway between light and camera"),
               ("PHONG", "Phong", "Use the mirror direction of the light")))
    two_sided: LiveBool(
        name="Two-Sided", default=True, description="Light surfaces from behind too, which suits noisy scans")


def _rescale_boxes(settings, context):
    _evaluate_anew(settings, context)
    for volume_object in settings.id_data.objects:
        if volume_object.rle_splat.is_volume:
            box.rescale_box(volume_object, scene_scale_of(settings.id_data, volume_object.rle_splat.length_unit))


def _place_backdrop(settings, context):
    """Move an existing backdrop behind or in front of the objects at once."""
    scene = settings.id_data
    entry = backdrop.find(scene, scene.camera) if scene.camera is not None and scene.camera.type == "CAMERA" else None
    if entry is not None:
        entry.display_depth = settings.backdrop_depth
    _evaluate_anew(settings, context)


class SceneSettings(bpy.types.PropertyGroup):
    """The settings of a scene's pictures, and the report of the last one."""

    scene_scale: FloatProperty(
        name="Scene Scale", description="World units per millimeter; with 0.001 a millimeter has its real size in "
        "meters", default=0.001, min=1e-9, soft_max=1.0, precision=6, update=_rescale_boxes)
    quality: KnobEnum(
        name="Quality", description="Balance of accuracy and time", items=QUALITY_ITEMS, default=USUAL.name)
    max_error: LiveFloat(
        name="Maximum Error", default=0.0, min=0.0, soft_max=16.0, precision=2,
        description="Largest allowed error of a color, in levels of 1/255. The fastest settings that keep it are "
        "chosen in place of Quality, and the picture's error is measured and reported. 0 uses Quality")
    classification: EnumProperty(
        name="Classification", description=_knob("classification"), items=CLASSIFICATION_ITEMS,
        default=USUAL.classification, update=_classification_chosen)
    refinement: LiveEnum(
        name="Refinement", description=_knob("refinement"), items=REFINEMENT_ITEMS, default=str(USUAL.refinement))
    depth_rule: KnobEnum(
        name="Depth Rule", description=_knob("depth_rule"), default=USUAL.depth_rule,
        items=_items((*tables.DEPTH_RULES, *tables.SCALAR_DEPTH_RULES)))
    kernel: KnobEnum(
        name="Footprint", description=_knob("kernel"), items=_items(tables.FOOTPRINTS), default=USUAL.kernel)
    minification: KnobEnum(
        name="Minification", description=_knob("minification"), items=_items(tables.MINIFICATIONS),
        default=USUAL.minification)
    warp_filter: LiveEnum(
        name="Warp Filter", description=_knob("warp_filter"), items=_items(tables.WARP_FILTERS),
        default=USUAL.warp_filter)
    model: KnobEnum(name="Model", description=_knob("model"), items=_items(tables.MODELS), default=USUAL.model)
    record: KnobEnum(
        name="Voxel Record", description=_knob("record"), items=RECORD_ITEMS, default=str(USUAL.record))
    sheet_density: LiveFloat(
        name="Sheet Density", description=_knob("sheet_density"), default=USUAL.sheet_density, min=0.0,
        max=tables.MOST_SHEET_DENSITY)
    termination: LiveFloat(
        name="Termination", description=_knob("termination"), default=USUAL.termination, min=0.0, max=0.499,
        precision=5)
    axis_fade: LiveFloat(
        name="Axis Fade", description=_knob("axis_fade"), default=USUAL.axis_fade, min=0.0, max=tables.MOST_FADE)
    rays: LiveFloat(
        name="Single Rays", description=_knob("rays"), default=USUAL.rays, min=0.0, soft_max=1.0, precision=3)
    threads: LiveInt(
        name="Threads", description="Number of threads; 0 uses all processor cores", default=0, min=0, soft_max=64)
    backend: LiveEnum(
        name="Backend", description=_knob("backend"), items=_items(tables.BACKENDS),
        default=USUAL.backend)
    mode: LiveEnum(name="Mode", description="What each pixel shows of the volume behind it", items=MODE_ITEMS)
    lighting: LiveEnum(name="Lighting", description="Lights that shine on the volume", items=LIGHTING_ITEMS)
    use_shadows: LiveBool(
        name="Shadows", default=True,
        description="Let lights whose own Shadow option is on cast shadows of the volume and of meshes on the volume. "
        "Not used with a Maximum Error")
    use_world: LiveBool(
        name="World Light", default=True,
        description="Light the volume from all sides with the world's color, in addition to the lights")
    use_mist: LiveBool(
        name="Mist", default=False,
        description="Fade the volume toward the world's color with distance, by the Mist settings of the world. The "
        "Mist pass of a view layer has no effect on the volume")
    ambient_occlusion: LiveFloat(
        name="Ambient Occlusion", default=0.0, min=0.0, max=1.0, precision=2,
        description="Darken places where the volume or a mesh blocks the light from all sides; 1 is full strength. "
        "Not used with a Maximum Error")
    clip_objects: LivePointer(
        name="Clip Objects", type=bpy.types.Collection,
        description="Collection of objects that cut the volume. Meshes and cube Empties cut as boxes, flat meshes and "
        "arrow Empties as planes. The part that all of them keep is shown")
    meshes_occlude: LiveBool(
        name="Meshes Occlude", description="Let meshes hide the part of the volume behind them, also inside the volume",
        default=True)
    backdrop_depth: EnumProperty(
        name="Place", description="Where the camera view shows the backdrop", update=_place_backdrop,
        items=[("BACK", "Behind", "Show the backdrop behind the objects"),
               ("FRONT", "In Front", "Show the backdrop in front of the objects")])
    backdrop_object: PointerProperty(
        name="Backdrop Volume", type=bpy.types.Object, description="Volume in the backdrop")
    backdrop_follows: BoolProperty(
        name="Follow Scene", default=False, update=_evaluate_anew,
        description="Update the backdrop when the frame, the camera, the volume, a light, a clip object or a setting "
        "changes")
    composite_object: PointerProperty(
        name="Composite Volume", type=bpy.types.Object, description="Volume that is composited into renders")
    deleted_volume: StringProperty(
        name="Deleted Volume", description="Name of the composited volume that was deleted", options={"HIDDEN"})
    composite_image: PointerProperty(
        name="Composite Picture", type=bpy.types.Image, description="Picture that is composited into renders")
    use_previews: BoolProperty(
        name="Progressive Preview", default=True,
        description="Show coarse pictures first if a picture in a window takes more than about 0.15 seconds. The final "
        "picture is the same, and Esc restores the previous one. Needs up to 100 MB of memory; scripts and renders "
        "show no previews")
    message: StringProperty(name="Message", description="Problem of the last render or frame change")
    render_problem: StringProperty(
        name="Problem of the Render", description="First problem of the last render, with the frames that failed")
    failed_frames: StringProperty(
        name="Failed Frames", description="Frames of the last render that could not be drawn, such as 2, 5-7")
    on_failed_frame: EnumProperty(
        name="If a Frame Fails", description="What happens if the volume cannot be drawn in a rendered frame",
        items=[("PLACEHOLDER", "Placeholder", "Show magenta stripes instead of the volume and continue"),
               ("STOP", "Stop", "Show magenta stripes instead of the volume and end the animation after this frame. "
                "Blender reports the animation as finished. A script that renders single frames continues")])
    use_composite: BoolProperty(
        name="Composite into Render", description="Render the volume with every frame and composite it",
        default=False)
    scene_id: StringProperty(
        name="Id", description="Id of this scene, stored in the images of its pictures", options={"HIDDEN"})
    pictures: CollectionProperty(type=PictureProperties, name="Pictures", description="Pictures of this scene")
    image: PointerProperty(name="Picture", type=bpy.types.Image, description="The last picture")
    depth_image: PointerProperty(name="Depth", type=bpy.types.Image, description="Depth of the last picture")
    last_report: StringProperty(name="Report", description="Report of the last picture, one fact per line")
    last_report_json: StringProperty(name="Report as JSON", description="Report of the last picture as JSON")
    effect_overrides: PointerProperty(
        type=EffectOverrideProperties, name="Effects by Hand", description="Effects that are forced on or off")
    effect_rows: CollectionProperty(
        type=EffectRowProperties, name="Effects", description="State of each effect")
    effects_note: StringProperty(name="Effects of", description="What the list of effects describes")
    accuracy_rows: CollectionProperty(
        type=AccuracyRowProperties, name="Measured Plans", description="Measured time and error of each plan")
    accuracy_note: StringProperty(name="Measurement", description="Volume, camera and size of the measurement")
    error_image: PointerProperty(name="Error Map", type=bpy.types.Image, description="The last error map")
    error_note: StringProperty(name="Errors", description="Summary of the last error map")


CLASSES = (
    EffectOverrideProperties, EffectRowProperties, AccuracyRowProperties, PictureProperties, LabelProperties,
    ChannelProperties, VolumeProperties, SceneSettings,
)


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
