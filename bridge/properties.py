"""What is kept in the .blend: a property group on each object, and one on the scene.

Voxels are not kept: ``VolumeProperties`` says how to read them again.  The curve and the colors of the transfer
function are in the node group ``transfer`` points at (see ``transfer.py``); its window is here, so that it
can be keyframed on the object.
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
from .settings import scene_scale_of, suit_classification, suit_knobs
from .source_options import SourceOptions
from .transfer_nodes import is_transfer_tree

QUALITY_TEXTS = {
    "draft": ("Draft", "A coarser sheet, fewer sheets: for moving about"),
    "standard": ("Standard", "One sheet pixel per image pixel"),
    "fine": ("Fine", "A denser sheet: for final pictures"),
    "strict": ("Strict", "Several sheets a slice: where errors must be as small as they get"),
}
CLASSIFICATION_TEXTS = {
    "pre": ("Pre", "As in the paper: voxels are classified, and colors and opacities interpolated. Softer edges; "
                   "every footprint, model and voxel record. Errors are against truth T1"),
    "refined": ("Refined", "As pre, on a finer grid of interpolated values: sharper edges, much more memory. Errors "
                           "are against truth T2"),
    "post": ("Post", "Values are interpolated, and classified in every sheet pixel: edges as sharp as a ray caster's. "
                     "Errors are against truth T2"),
}
CLASSIFICATION_ITEMS = [(name, *CLASSIFICATION_TEXTS[name]) for name in tables.CLASSIFICATIONS]
QUALITY_ITEMS = [(name, *QUALITY_TEXTS.get(name, (name.title(), ""))) for name in tables.QUALITY_PRESETS] + [
    ("paper", "Paper", "The paper's literal pipeline: opacities added in slice planes, one sheet pixel per voxel"),
    ("custom", "Custom", "Every knob by hand"),
]
RECORD_ITEMS = [(str(size), f"{size} Bytes", "") for size in tables.RECORDS]
REFINEMENT_ITEMS = [(str(times), f"{times} Times", "") for times in tables.REFINEMENTS]
MODE_ITEMS = [
    (name, MODE_NAMES[name] if name != "composite" else "Composite", text[0].upper() + text[1:])
    for name, text in tables.MODE_TEXTS.items()
]
LIGHTING_ITEMS = [
    ("SCENE", "Scene Lights", "The lights of the scene; a headlight when there are none"),
    ("HEADLIGHT", "Headlight", "One white parallel light along the camera's axis"),
    ("NONE", "Unlit", "The colors of the transfer function, unshaded"),
]


CLIP_ITEMS = [
    ("INSIDE", "Inside", "What is in the box stays, or what is behind the plane: its +Z points at what is cut away"),
    ("OUTSIDE", "Outside", "What is around the box stays, or what is before the plane"),
]


def _evaluate_anew(group, _context):
    """Pictures are made from evaluated copies; Blender refreshes them by itself when a user edits a property of an
    extension, but not when a script does."""
    group.id_data.update_tag()


def _knob_chosen(settings, context):
    suit_classification(settings)
    _evaluate_anew(settings, context)


def _classification_chosen(settings, context):
    suit_knobs(settings)
    _evaluate_anew(settings, context)


# Properties that decide a picture.
LiveBool, LiveEnum, LiveFloat, LiveInt, LivePointer, LiveString = (
    partial(kind, update=_evaluate_anew)
    for kind in (BoolProperty, EnumProperty, FloatProperty, IntProperty, PointerProperty, StringProperty)
)


# Those whose values not every classification has.
KnobEnum = partial(EnumProperty, update=_knob_chosen)
USUAL = tables.Quality()  # knobs' values where nobody chose any


def _knob(name: str) -> str:
    text = tables.KNOB_TEXTS[name]
    return text[0].upper() + text[1:]


def _items(names):
    return [(name, name.replace("_", " ").title(), "") for name in names]


class VolumeProperties(SourceOptions, bpy.types.PropertyGroup):
    """The source, the facts and the window of one volume object."""

    is_volume: BoolProperty(name="Is a Volume", default=False, options={"HIDDEN"})
    filepath: StringProperty(
        name="File", description="The volume's file, relative to the .blend where it can be", subtype="FILE_PATH",
        options={"PATH_SUPPORTS_BLEND_RELATIVE"})
    data_key: StringProperty(name="Data Hash", description="Hash of the voxels when they were imported")
    facts: StringProperty(name="Facts", description="What the volume is, one fact a line")
    remarks: StringProperty(name="Remarks", description="What is odd about the data, one sentence a line")
    histogram: StringProperty(name="Histogram", description="Counts of the voxels' values, JSON")
    length_unit: StringProperty(name="Length Unit", description="Unit of the volume's own space", default="mm")
    value_low: FloatProperty(name="Smallest Value", description="Smallest physical value of the volume")
    value_high: FloatProperty(name="Largest Value", description="Largest physical value of the volume", default=1.0)

    label_file: LiveString(
        name="Labels", description="A volume of whole numbers on the same grid: what each voxel belongs to. With "
        "labels that are hidden or have a look of their own, pictures are classified by pre", subtype="FILE_PATH",
        options={"PATH_SUPPORTS_BLEND_RELATIVE"})
    labels: CollectionProperty(type=LabelProperties, name="Labels", description="What each label looks like")
    channels: CollectionProperty(
        type=ChannelProperties, name="Channels", description="Further volumes on the same grid that are added")
    clip_keep: LiveEnum(
        name="Keep", description="Which side of this clip object stays", items=CLIP_ITEMS)
    transfer: LivePointer(
        name="Transfer Function", type=bpy.types.NodeTree, poll=lambda self, tree: is_transfer_tree(tree),
        description="Node group that holds the colors and the opacity curve; shared by copies of the object")
    transfer_name: LiveString(name="Preset", description="Name of the transfer function last applied")
    transfer_unit: LiveString(name="Unit", description="Unit of the transfer function's values")
    window_center: LiveFloat(
        name="Level", description="Value in the middle of the colors and the curve", default=0.5, precision=2)
    window_width: LiveFloat(
        name="Window", description="Span of values that the colors and the curve cover", default=1.0, min=1e-6,
        precision=2)
    opacity_scale: LiveFloat(
        name="Opacity", description="Factor on the whole opacity curve", default=1.0, min=0.0, soft_max=2.0)
    opacity_unit_distance: LiveFloat(
        name="Opacity Distance", description="Length, in the volume's unit, to which the curve's opacities "
        "refer; zero for the smallest spacing of the voxels", default=0.0, min=0.0, precision=4)
    use_shading: LiveBool(name="Shading", description="Light the volume by its gradients", default=True)
    ambient: LiveFloat(name="Ambient", default=0.2, min=0.0, soft_max=1.0, description="Unlit share of the color")
    diffuse: LiveFloat(name="Diffuse", default=0.8, min=0.0, soft_max=1.0, description="Share that faces the light")
    use_gradient_opacity: LiveBool(
        name="Surfaces Only", default=False,
        description="Multiply the opacity by how steep the values are, so that surfaces stay and what is even goes")
    gradient_low: LiveFloat(
        name="Gradient From", default=0.0, min=0.0, soft_max=1000.0, precision=2,
        description="Values per unit of the volume's length, such as HU per mm, up to which nothing is opaque")
    gradient_high: LiveFloat(
        name="To", default=100.0, min=0.0, soft_max=1000.0, precision=2,
        description="Values per unit of length from which the opacity curve holds in full")
    specular: LiveFloat(name="Specular", default=0.2, min=0.0, soft_max=1.0, description="White highlight")
    shininess: LiveFloat(
        name="Shininess", default=20.0, min=1.0, soft_max=100.0, description="Exponent of the highlight")
    highlight: LiveEnum(
        name="Highlight", default="BLINN_PHONG",
        items=(("BLINN_PHONG", "Blinn-Phong", "By the direction half-way between light and eye"),
               ("PHONG", "Phong", "By the light's mirror image in the surface")))
    two_sided: LiveBool(
        name="Two-Sided", default=True, description="Light surfaces from behind as well, as noisy scans need it")


def _rescale_boxes(settings, context):
    _evaluate_anew(settings, context)
    for volume_object in settings.id_data.objects:
        if volume_object.rle_splat.is_volume:
            box.rescale_box(volume_object, scene_scale_of(settings.id_data, volume_object.rle_splat.length_unit))


def _place_backdrop(settings, context):
    """Show an existing backdrop at its new place at once."""
    scene = settings.id_data
    entry = backdrop.find(scene, scene.camera) if scene.camera is not None and scene.camera.type == "CAMERA" else None
    if entry is not None:
        entry.display_depth = settings.backdrop_depth
    _evaluate_anew(settings, context)


class SceneSettings(bpy.types.PropertyGroup):
    """How the pictures of a scene are made, and what the last one reported."""

    scene_scale: FloatProperty(
        name="Scene Scale", description="World units for each millimeter: 0.001 shows millimeters in meters",
        default=0.001, min=1e-9, soft_max=1.0, precision=6, update=_rescale_boxes)
    quality: KnobEnum(
        name="Quality", description="How much time is spent on accuracy", items=QUALITY_ITEMS, default=USUAL.name)
    max_error: LiveFloat(
        name="Maximum Error", default=0.0, min=0.0, soft_max=16.0, precision=2,
        description="Largest error of any channel, in levels of 1/255: the quickest plan that keeps it is chosen, and "
        "the picture is measured against the truth. Of Quality only the classification counts then. Zero for none")
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
    threads: LiveInt(name="Threads", description="Zero for one per core", default=0, min=0, soft_max=64)
    backend: LiveEnum(
        name="Backend", description=_knob("backend"), items=_items(tables.BACKENDS),
        default=USUAL.backend)
    mode: LiveEnum(name="Mode", description="What a pixel shows of its ray", items=MODE_ITEMS)
    lighting: LiveEnum(name="Lighting", description="What lights the volume", items=LIGHTING_ITEMS)
    use_shadows: LiveBool(
        name="Shadows", default=True,
        description="Lights of the scene whose own Shadow is on cast shadows in the volume: its own, and those of the "
        "meshes that occlude it. Not with a Maximum Error")
    use_world: LiveBool(
        name="World Light", default=True,
        description="The world's color shines from everywhere, beside the lights of the scene")
    use_mist: LiveBool(
        name="Mist", default=False,
        description="Fade the volume's colors towards the world's color with their distance, by the world's Mist "
        "settings. The Mist pass of a view layer changes no picture; turn this on in files that relied on it")
    ambient_occlusion: LiveFloat(
        name="Ambient Occlusion", default=0.0, min=0.0, max=1.0, precision=2,
        description="How much of the light from everywhere is taken away where the volume or a mesh hides the sky. Not "
        "with a Maximum Error")
    clip_objects: LivePointer(
        name="Clip Objects", type=bpy.types.Collection,
        description="Objects that cut the volume: meshes and cube Empties as boxes, flat meshes and arrow Empties as "
        "planes. What all of them keep is shown")
    meshes_occlude: LiveBool(
        name="Meshes Occlude", description="Stop each ray at the first mesh surface, also inside the volume",
        default=True)
    backdrop_depth: EnumProperty(
        name="Place", description="Where the camera shows the backdrop", update=_place_backdrop,
        items=[("BACK", "Behind", "Behind the scene's objects"), ("FRONT", "In Front", "In front of them")])
    backdrop_object: PointerProperty(
        name="Backdrop Volume", type=bpy.types.Object, description="The volume whose picture the camera shows")
    backdrop_follows: BoolProperty(
        name="Follow Scene", default=False, update=_evaluate_anew,
        description="Make the backdrop anew when the frame, the camera, the volume, a light, a clip object or a "
        "setting changes")
    composite_object: PointerProperty(
        name="Composite Volume", type=bpy.types.Object, description="The volume that is laid over renders")
    deleted_volume: StringProperty(
        name="Deleted Volume", description="What the composited volume was called that was deleted",
        options={"HIDDEN"})
    composite_image: PointerProperty(
        name="Composite Picture", type=bpy.types.Image, description="The picture that is laid over renders")
    use_previews: BoolProperty(
        name="Progressive Preview", default=True,
        description="While a picture is made in a window, or a backdrop follows the timeline, show coarse ones "
        "first, with a bound on their error where the classification is pre, if it is likely to take more than 0.15 "
        "seconds from when the volume is classified. The picture stays the same; Esc brings the former one back. "
        "Takes up to 100 MB of memory; scripts and renders have no previews")
    message: StringProperty(name="Message", description="What went wrong in the last render or frame change")
    render_problem: StringProperty(
        name="Problem of the Render", description="What the last render does not show and why: its first error, with "
        "the frames that failed")
    failed_frames: StringProperty(
        name="Failed Frames", description="Frames of the last render that could not be drawn, such as 2, 5-7")
    on_failed_frame: EnumProperty(
        name="If a Frame Fails", description="What becomes of a rendered frame in which the volume cannot be drawn",
        items=[("PLACEHOLDER", "Placeholder", "Magenta stripes stand in for the volume, and the render goes on"),
               ("STOP", "Stop", "Magenta stripes stand in for the volume, and an animation ends after that frame. "
                "Blender counts it as finished, since an extension cannot cancel a render. A script that renders one "
                "still after the other goes on")])
    use_composite: BoolProperty(
        name="Composite into Render", description="Splat anew for every rendered frame and lay it over the render",
        default=False)
    scene_id: StringProperty(
        name="Id", description="Names this scene in the images that are its pictures", options={"HIDDEN"})
    pictures: CollectionProperty(type=PictureProperties, name="Pictures", description="The images of this scene")
    image: PointerProperty(name="Picture", type=bpy.types.Image, description="The last picture")
    depth_image: PointerProperty(name="Depth", type=bpy.types.Image, description="The depth of the last picture")
    last_report: StringProperty(name="Report", description="What the last picture took, one line each")
    last_report_json: StringProperty(name="Report as JSON", description="The machine-readable report")
    effect_overrides: PointerProperty(type=EffectOverrideProperties, name="Effects by Hand")
    effect_rows: CollectionProperty(type=EffectRowProperties, name="Effects")
    effects_note: StringProperty(name="Effects of", description="What the list of effects was made out from")
    accuracy_rows: CollectionProperty(type=AccuracyRowProperties, name="Measured Plans")
    accuracy_note: StringProperty(name="Measurement", description="What the measured plans were measured on")
    error_image: PointerProperty(name="Error Map", type=bpy.types.Image, description="The last map of errors")
    error_note: StringProperty(name="Errors", description="What the last map of errors holds")


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
