"""The properties of a volume object, and of its slices and cutting objects.

Voxels are not saved; ``VolumeProperties`` holds the file and the options to read them again.  The curve and the colors
of the transfer function are in the node group ``transfer`` (see ``transfer.py``).  Its window is a property of the
object, so that it can be keyframed.
"""

import bpy

from ...rle_splat import scene as tables
from ...rle_splat.segment.label_map import BACKGROUND
from ..look import mode_window
from ..look.preset_entries import modality_of
from ..look.transfer_nodes import is_transfer_tree
from ..loop import index
from ..translations import OURS
from ..volumes.channels import ChannelProperties
from ..volumes.labels import LabelProperties
from ..volumes.source_paths import make_absolute
from .automatic import switch
from .overridable import (
    BoolProperty,
    CollectionProperty,
    EnumProperty,
    FloatProperty,
    FloatVectorProperty,
    IntProperty,
    LiveBool,
    LiveEnum,
    LiveFloat,
    LivePointer,
    LiveString,
    PointerProperty,
    StringProperty,
    evaluate_anew,
)  # fmt: skip
from .playback import Playback
from .settings import scene_scale_of
from .source_options import SourceOptions

DISPLAY_ITEMS = [
    ("composite", "Volume Rendering", "Show the colors and opacities of the transfer function, with light"),
    ("mip", "MIP", "Maximum intensity projection: show the largest value along each line of sight"),
    ("minip", "MinIP", "Minimum intensity projection: show the smallest value along each line of sight"),
    ("average", "Average", "Average intensity projection: show the mean value along each line of sight"),
    ("xray", "X-Ray", "Show how much is absorbed along each line of sight: dense tissue is bright"),
]
SHOWN = tuple(item[0] for item in DISPLAY_ITEMS)  # the modes in the order of the panel
MODE_ITEMS = [DISPLAY_ITEMS[SHOWN.index(name)] for name in tables.MODES]  # in that of files
SHIFT = (
    "Slide colors and opacity along the values, in their unit: a negative shift shows less dense material, too. Level "
    "moves with them"
)
TABLE = "Hide the table or head holder of a CT"
BESIDE_TOO = "What lies apart from the body, such as arms and blankets, is hidden with it"
SHOWN_AGAIN = (
    f"{BESIDE_TOO}. To show it again, click Hide Table in Display or, with further segments, the eye of Background"
)
LIGHTING_ITEMS = [
    ("SCENE", "Scene Lights", "Use the lights of the scene, or a headlight if there are none"),
    ("HEADLIGHT", "Headlight", "Use one white parallel light that shines along the camera's axis"),
    ("NONE", "Unlit", "Show the colors of the transfer function without lights"),
    ("BOTH", "Scene Lights and Headlight", "Use the lights of the scene and a headlight together"),
]
KEEP_OUTSIDE = "Keep what is outside the box, or on the side to which the plane's arrow points"
CLIP_ITEMS = [
    ("INSIDE", "Inside", "Keep what is inside the box, or behind the plane, whose arrow points to what is removed"),
    ("OUTSIDE", "Outside", KEEP_OUTSIDE),
]


def _shift_of(group) -> float:
    if not group.is_property_set("preset_center"):  # of a file of an earlier version
        return 0.0
    return group.window_center - group.preset_center


def _shift(group, by: float) -> None:
    if not group.is_property_set("preset_center"):
        group.preset_center = group.window_center
    group.window_center = group.preset_center + by


def _find_slice(group) -> tuple[float, float]:
    """The coordinate of a slice's middle along its volume's axis, and the step of it for 1 of its own location z.

    The coordinate is that of the file's space, a patient's for example, along the axis nearest to the volume's, in the
    volume's unit of length.
    """
    one = group.id_data
    to_volume = one.matrix_parent_inverse
    along = to_volume.to_3x3().col[2]
    axis = max(range(3), key=lambda i: abs(along[i]))
    unit = one.parent.rle_splat.length_unit if one.parent is not None else ""
    scale = scene_scale_of(bpy.context.scene, unit) or 1.0
    return (to_volume @ one.location)[axis] / scale, along[axis] / scale or 1.0


def _slice_position(group) -> float:
    return _find_slice(group)[0]


def _move_slice(group, to: float) -> None:
    at, step = _find_slice(group)
    group.id_data.location.z += (to - at) / step


def _switch_cut(group, on: bool) -> None:
    group.id_data.hide_render = not on


def _flip(group, on: bool) -> None:
    group.clip_keep = "OUTSIDE" if on else "INSIDE"


def _hide_table(group, on: bool) -> None:
    if len(group.labels) > BACKGROUND:
        group.labels[BACKGROUND].show = not on


def _labels_chosen(group, context):
    make_absolute(group, "label_file")
    group.label_frames = 1  # until it is read
    evaluate_anew(group, context)


def _unlink_slices(group, context):
    """Slices that get a window of their own begin with that of the volume, unless they had one before."""
    if not group.slices_follow_window and not group.is_property_set("slice_width"):
        group.slice_center, group.slice_width = group.window_center, group.window_width
    evaluate_anew(group, context)


def _look_again(_properties, _context):
    index.forget()


def _mode_of(group) -> int:
    return SHOWN.index(group.mode)


def _choose_mode(group, index: int) -> None:
    """Set the mode with the look and the window that suit it; ``mode`` alone leaves both as they are."""
    if index == _mode_of(group):
        return
    was_shaded = group.mode == tables.MODES[0]
    group.mode = SHOWN[index]
    group.use_grays = group.mode != tables.MODES[0]
    group.use_inverted_grays = modality_of(group) == "PT"
    if was_shaded:
        group.shaded_window = group.window_center, group.window_width, group.preset_center
    if group.use_grays:
        mode_window.suit(group.id_data)
    elif group.is_property_set("shaded_window"):
        group.window_center, group.window_width, group.preset_center = group.shaded_window


class VolumeProperties(Playback, SourceOptions, bpy.types.PropertyGroup):
    """The source, facts, transfer function and shading of one volume object."""

    is_volume: BoolProperty(
        name="Is a Volume", description="This object is a volume of RLE Splat", default=False, options={"HIDDEN"},
        update=_look_again)  # fmt: skip
    filepath: StringProperty(
        name="File", description="File of the volume, relative to the .blend if possible", subtype="FILE_PATH",
        options={"PATH_SUPPORTS_BLEND_RELATIVE"},
        update=lambda group, _context: make_absolute(group, "filepath"))  # fmt: skip
    data_key: StringProperty(name="Data Hash", description="Hash of the voxels at the import")
    files_digest: StringProperty(
        name="Files Hash", description="Hash of the names, sizes and times of the volume's files at the import"
    )
    facts: StringProperty(name="Facts", description="Facts about the volume, one per line")
    remarks: StringProperty(name="Notes", description="Notes on unusual data, one sentence per line")
    histogram: StringProperty(name="Histogram", description="Histogram of the values as JSON")
    stored_transfer: StringProperty(
        name="Stored Transfer Function", description="Transfer function of encoded voxels (.rle) as JSON; empty for "
        "other volumes", options={"HIDDEN"})  # fmt: skip
    space: StringProperty(
        name="Space", description='"patient" if the file says where the patient\'s left, front and head are'
    )
    length_unit: StringProperty(name="Length Unit", description="Unit of length of the file", default="mm")
    value_low: FloatProperty(name="Smallest Value", description="Smallest physical value of the volume")
    value_high: FloatProperty(name="Largest Value", description="Largest physical value of the volume", default=1.0)

    label_file: StringProperty(
        name="Segmentation File", description="File with the segments: a label map, a folder of masks, DICOM SEG or "
        "RTSTRUCT. It is matched to the scan by its place in the patient",
        subtype="FILE_PATH", options={"PATH_SUPPORTS_BLEND_RELATIVE"}, update=_labels_chosen)  # fmt: skip
    labels: CollectionProperty(type=LabelProperties, name="Segments", description="Appearance of each segment")
    hide_table: BoolProperty(
        name="Hide Table", description=f"{TABLE}. {BESIDE_TOO}; click again to show it", set=_hide_table,
        get=lambda group: len(group.labels) > BACKGROUND and not group.labels[BACKGROUND].show)  # fmt: skip
    labels_of: StringProperty(
        name="Segments Of", description="Name of the segmentation file whose segments are listed", options={"HIDDEN"}
    )
    label_frames: IntProperty(
        name="Frames of Segments", description="Number of volumes in the segmentation file; above 1 the segments "
        "change with time", options={"HIDDEN"}, default=1, min=1)  # fmt: skip
    active_label: IntProperty(
        name="Chosen Segment", description="Segment whose settings are below the list", default=0, min=0
    )
    smooth_labels: LiveBool(
        name="Smooth Edges", description="Smooth the edges of segments instead of showing the steps of their voxels",
        default=True)  # fmt: skip
    channels: CollectionProperty(
        type=ChannelProperties,
        name="Channels",
        description="Volumes shown together with this one, such as a PET on its CT",
    )
    clip_flipped: BoolProperty(
        name="Keep Other Side", description=KEEP_OUTSIDE, set=_flip,
        get=lambda group: group.clip_keep == "OUTSIDE")  # fmt: skip
    clip_is_on: BoolProperty(
        name="Enable Cut",
        description="Turn this cut on or off",
        set=_switch_cut,
        get=lambda group: not group.id_data.hide_render,
    )
    clip_keep: LiveEnum(name="Keep", description="Part of the volume that this cutting object keeps", items=CLIP_ITEMS)
    clip_only_parent: LiveBool(
        name="Cut Only This Volume", default=False,
        description="Cut only the volume that this object is a child of, not the others in the scene")  # fmt: skip
    is_slice: BoolProperty(
        name="Is a Slice", description="This mesh shows a slice of the volume that it is a child of", default=False,
        options={"HIDDEN"}, update=_look_again)  # fmt: skip
    is_shadow_grid: BoolProperty(
        name="Is for Shadows", description="This object lets renders show the shadow of the volume that it is a child "
        "of, and its reflection", default=False, options={"HIDDEN"})  # fmt: skip
    slice_kind: StringProperty(
        name="Kind of Slice", description="How the slice lay when it was added: axial, coronal or sagittal",
        options={"HIDDEN"})  # fmt: skip
    slice_position: FloatProperty(
        name="Position", description="Position of the slice along the volume's axis. For patients in mm, in "
        "DICOM's coordinates. L+, P+ and S+: the number grows toward the left, back or head",
        precision=1, step=100, options=set(), get=_slice_position, set=_move_slice)  # fmt: skip
    slices_follow_window: BoolProperty(
        name="Volume's Window", default=True, update=_unlink_slices,
        description="Let slices use the window and level of the volume's colors instead of their own. The first slice "
        "turns this off, unless it was set before")  # fmt: skip
    slice_center: LiveFloat(
        name="Slice Level", description="Value that slices and gray values on cuts show as middle gray", default=0.5,
        precision=2, translation_context=OURS)  # fmt: skip
    slice_width: LiveFloat(
        name="Slice Window", description="Width of the range of values that slices and gray values on cuts show from "
        "black to white", default=1.0, min=1e-6, precision=2)  # fmt: skip
    slices_clear_black: LiveBool(
        name="Transparent Black",
        default=False,
        description="Make transparent what slices would show black, such as the air around the body. The volume "
        "behind it shows there",
    )
    slice_image: PointerProperty(name="Slice", type=bpy.types.Image, description="The image that this slice shows")
    transfer: LivePointer(
        name="Transfer Function", type=bpy.types.NodeTree, poll=lambda self, tree: is_transfer_tree(tree),
        description="Colors and opacity curve, stored in a node group. Copies of the object share it")  # fmt: skip
    transfer_name: LiveString(name="Preset", description="Name of the transfer function last applied")
    transfer_unit: LiveString(name="Unit", description="Unit of the transfer function's values")
    window_center: LiveFloat(
        name="Level", description="Value at the center of the colors and the opacity curve", default=0.5, precision=2,
        translation_context=OURS)  # fmt: skip
    window_width: LiveFloat(
        name="Window", description="Width of the range of values that the colors and the opacity curve cover",
        default=1.0, min=1e-6, precision=2)  # fmt: skip
    preset_center: FloatProperty(
        name="Level of the Preset", description="Level of the transfer function when it was last applied",
        options={"HIDDEN"})  # fmt: skip
    shift_by: FloatProperty(  # a drag moves it by a unit for each pixel
        name="Shift", translation_context=OURS, step=100, precision=1, get=_shift_of, set=_shift,
        description=SHIFT)  # fmt: skip
    shift_finely: FloatProperty(
        name="Shift", translation_context=OURS, step=1, precision=3, get=_shift_of, set=_shift,
        description=SHIFT)  # fmt: skip
    opacity_scale: LiveFloat(
        name="Opacity", description="Multiply the opacity of the whole volume", default=1.0, min=0.0, soft_max=1.0
    )
    opacity_unit_distance: LiveFloat(
        name="Opacity Unit Distance", description="Thickness of material, in mm for patients, that has the "
        "opacity shown by the curve. Smaller is more opaque: about 0.05 mm makes thin bone opaque",
        default=0.0, min=0.0, precision=4)  # fmt: skip
    use_smallest_spacing: BoolProperty(
        name="Automatic", description="Use the smallest voxel spacing",
        **switch("opacity_unit_distance", 0.0, 1.0))  # fmt: skip
    use_shading: LiveBool(
        name="Surface Shading", description="Shade surfaces by their angle to the light", default=True
    )
    ambient: LiveFloat(
        name="Ambient", default=0.2, min=0.0, soft_max=1.0,
        description="Brightness of the colors without any light. More of it makes shapes look flatter; the light of "
        "the world is World Light")  # fmt: skip
    diffuse: LiveFloat(
        name="Diffuse", default=0.8, min=0.0, soft_max=1.0, description="Brightness of surfaces that face a light"
    )
    mode: LiveEnum(name="Mode", description="What each pixel shows of the volume behind it", items=MODE_ITEMS)
    use_grays: LiveBool(
        name="Grays",
        default=False,
        description="Show the values in gray, by Window and Level, instead of the colors of the preset. Not used "
        "in the mode Volume Rendering",
    )
    use_inverted_grays: LiveBool(
        name="Inverted",
        default=False,
        description="Show high values black, as a PET is read, for a white background. Not used in the mode X-Ray",
    )
    display: EnumProperty(
        name="Mode", description="What each pixel shows of the volume behind it. Modes other than Volume Rendering "
        "begin with grays and a window and level that suit them", items=DISPLAY_ITEMS, get=_mode_of,
        set=_choose_mode)  # fmt: skip
    shaded_window: FloatVectorProperty(
        name="Window of Volume Rendering", description="Level, window and level of the preset, for when the mode is "
        "Volume Rendering again", size=3, options={"HIDDEN"})  # fmt: skip
    lighting: LiveEnum(name="Light Source", description="Lights that shine on the volume", items=LIGHTING_ITEMS)
    use_gradient_opacity: LiveBool(
        name="Gradient Opacity", default=False, description="Multiply the opacity by a curve over the gradient, so "
        "that uniform regions become transparent and surfaces remain")  # fmt: skip
    gradient_low: LiveFloat(
        name="Gradient From", default=0.0, min=0.0, soft_max=1000.0, precision=2, description="Gradient at the left "
        "end of the curve: change of the values per unit of length, such as HU per mm")  # fmt: skip
    gradient_high: LiveFloat(
        name="Gradient To", default=100.0, min=0.0, soft_max=1000.0, precision=2,
        description="Gradient at the right end of the curve")  # fmt: skip
    specular: LiveFloat(
        name="Specular", default=0.2, min=0.0, soft_max=1.0,
        description="Brightness of the highlights, in the color of the light")  # fmt: skip
    shininess: LiveFloat(
        name="Shininess", default=20.0, min=1.0, soft_max=100.0,
        description="Sharpness of the highlights, the opposite of roughness: about 10 looks matte, 60 wet")  # fmt: skip
    smoothness: LiveFloat(
        name="Smoothness", default=-1.0, min=-1.0, soft_max=10.0, precision=2,
        description="How far, in mm, surfaces are smoothed for light (standard deviation of a Gaussian). Removes the "
        "rings of thick slices and rounds fine edges. 0 is off")  # fmt: skip
    use_automatic_smoothness: BoolProperty(
        name="Automatic", description="Smooth surfaces for light by the largest voxel spacing, at most 2 mm",
        **switch("smoothness", -1.0, 1.0))  # fmt: skip
    two_sided: LiveBool(
        name="Two-Sided",
        default=True,
        description="Light both sides of a surface, including the one that faces away from the light. Suits noisy "
        "scans",
    )
