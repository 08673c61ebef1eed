"""Conversion of a volume object's transfer function between plain data and the .blend.

Positions 0 to 1 of the color ramp and the opacity curve cover the values of the window, a property of the object.
Moving the window moves all points, like window and level on a scanner's console.  A copy of an object shares the node
group, as copies share a material, but has its own window.
"""

from ...rle_splat.classify.transfer_function import RAMP, GradientOpacity, Shade, TransferFunction
from ...rle_splat.scene import MODES, RleSplatError
from ...rle_splat.scene.color import decode_srgb
from .. import linked
from ..data.decimals import rounded_to_span, typed, typed_tuple
from ..data.playback import curves_of
from ..volumes import encoded
from . import transfer_nodes as nodes
from .mode_window import XRAY_ALPHA

GRAYS = tuple(step / 32 for step in range(33))  # sRGB; straight lines between them are off by 0.4 of 1/255 at most


def window_of(properties) -> tuple[float, float]:
    """The window of a volume: physical values at positions 0 and 1 of ramp and curve."""
    center, width = typed_tuple((properties.window_center, properties.window_width))
    return center - 0.5 * width, center + 0.5 * width


def write_transfer(volume_object, transfer_function: TransferFunction, window=None) -> str:
    """Store a transfer function in a node group, window and shading; returns a sentence on what is inexact, or "".

    Parameters
    ----------
    volume_object : bpy.types.Object
        The volume object; it gets a node group if it has no local one.
    window : tuple of float, optional
        Low and high value of the window; default is the range of the function's points.
    """
    properties = volume_object.rle_splat
    low, high = _usable_window(transfer_function, properties) if window is None else window
    properties.window_center = 0.5 * (low + high)
    properties.window_width = high - low
    properties.preset_center = properties.window_center
    low, high = window_of(properties)  # rounded by the properties, so that reading gives the same values
    tree = properties.transfer
    if tree is None or not nodes.is_transfer_tree(tree) or not linked.is_own(tree):  # overrides of curves are lost
        properties.transfer = nodes.new_tree(volume_object.name)
    opacity = _cropped(_without_inner_repeats(transfer_function.opacity), low, high, transfer_function.alpha_at)
    color = _cropped(_without_inner_repeats(transfer_function.color), low, high, transfer_function.color_at)
    kept = nodes.fewest_stops(color)
    scale = 1.0 / (high - low)
    nodes.write_curve(
        nodes.opacity_mapping(properties.transfer), [(_unit((v - low) * scale), alpha) for v, alpha in opacity]
    )
    nodes.write_ramp(
        nodes.color_ramp(properties.transfer), [(_unit((color[i][0] - low) * scale), *color[i][1:]) for i in kept]
    )
    properties.property_unset("shaded_window")  # the new one is for all modes
    properties.transfer_name = transfer_function.name
    properties.transfer_unit = transfer_function.unit or ""
    properties.opacity_unit_distance = transfer_function.opacity_unit_distance or 0.0
    properties.opacity_scale = 1.0
    properties.use_shading = transfer_function.shade is not None
    if transfer_function.shade is not None:
        for name in ("ambient", "diffuse", "specular", "shininess", "two_sided"):
            setattr(properties, name, getattr(transfer_function.shade, name))
        smoothness = transfer_function.shade.smoothness
        properties.smoothness = AUTOMATIC if smoothness is None else smoothness
    steep = transfer_function.gradient_opacity
    properties.use_gradient_opacity = steep is not None
    if steep is not None:
        properties.gradient_low, properties.gradient_high = steep.low, steep.high
    nodes.add_gradient_node(properties.transfer)
    nodes.write_curve(nodes.gradient_mapping(properties.transfer), RAMP if steep is None else steep.curve)
    if len(kept) < len(color):
        return (f"The transfer function has {len(color)} colors, but a color ramp in Blender holds {nodes.MOST_STOPS}; "
                f"the {nodes.MOST_STOPS} that keep it closest to the original were stored.")  # fmt: skip
    return ""


def why_unusable(volume_object) -> str:
    """Why a volume object has no usable transfer function: a clause that says what to do, without a period, or ""."""
    tree = volume_object.rle_splat.transfer
    if encoded.is_of(volume_object):
        return ""
    if tree is None or not nodes.is_marked(tree):
        return f"{volume_object.name!r} has no transfer function; apply a preset in the RLE Splat tab"
    missing = nodes.missing_nodes(tree)
    if missing:
        return (f"The transfer function of {volume_object.name!r} lacks its node {missing[0]!r}; undo, or apply a "
                "preset in the RLE Splat tab")  # fmt: skip
    return ""


def read_transfer(volume_object, depsgraph=None) -> TransferFunction:
    """Read the transfer function of a volume object; RleSplatError if the object has no usable transfer function.

    Parameters
    ----------
    depsgraph : bpy.types.Depsgraph, optional
        The evaluated scene, for the animated values at its frame.
    """
    if encoded.is_of(volume_object):
        return encoded.transfer_of(volume_object)
    source = volume_object if depsgraph is None else volume_object.evaluated_get(depsgraph)
    properties = source.rle_splat
    tree = properties.transfer
    problem = why_unusable(source)
    if problem:
        raise RleSplatError(f"{problem}.")
    # A script's edits of the points are evaluated only after a tag; the original tree has them at once.
    curve_of, ramp_of, steep_of = (
        tree.original.evaluated_get(depsgraph) if depsgraph is not None and _is_animated(tree.original, name)
        else tree.original for name in nodes.NODES)  # fmt: skip
    low, high = window_of(properties)
    width = high - low
    scale = typed(properties.opacity_scale)
    at, alphas = zip(*nodes.read_curve(nodes.opacity_mapping(curve_of)))
    alphas = [min(1.0, max(0.0, alpha * scale)) for alpha in typed_tuple(alphas)]
    opacity = zip(rounded_to_span([low + one * width for one in at], width), alphas)
    at, *channels = zip(*nodes.read_ramp(nodes.color_ramp(ramp_of)))
    channels = [[max(0.0, one) for one in typed_tuple(channel)] for channel in channels]
    color = zip(rounded_to_span([low + one * width for one in at], width), *channels)
    shade = None
    if properties.use_shading:
        numbers = typed_tuple(getattr(properties, n) for n in ("ambient", "diffuse", "specular", "shininess"))
        smoothness = typed(properties.smoothness)
        shade = Shade(*numbers, properties.two_sided, None if smoothness < 0.0 else smoothness)
    steep = None
    if properties.use_gradient_opacity:
        curve = nodes.gradient_mapping(steep_of)
        points = RAMP if curve is None else [(p, min(1.0, max(0.0, typed(f)))) for p, f in nodes.read_curve(curve)]
        steep = GradientOpacity(typed(properties.gradient_low), typed(properties.gradient_high), tuple(points))
    return TransferFunction(
        name=properties.transfer_name, unit=properties.transfer_unit or None, opacity=tuple(opacity),
        color=tuple(color), opacity_unit_distance=typed(properties.opacity_unit_distance) or None, shade=shade,
        gradient_opacity=steep)  # fmt: skip


def shown_transfer(volume_object, depsgraph=None) -> TransferFunction:
    """The transfer function that a volume object is shown with: its own, or in its mode grays by level and window.

    Parameters
    ----------
    depsgraph : bpy.types.Depsgraph, optional
        As for ``read_transfer``.

    Returns
    -------
    TransferFunction
        With grays, the sRGB gray over black is proportional to the value, from 0 at the low end of the window to 1 at
        the high end; inverted, it is 1 less that, over white. In the mode X-Ray the opacity is, up to XRAY_ALPHA per
        smallest spacing. All modes but MinIP show the low end as transparent: most lines have the value of air.

    Raises
    ------
    RleSplatError
        If the object has no usable transfer function.
    """
    own = read_transfer(volume_object, depsgraph)
    properties = (volume_object if depsgraph is None else volume_object.evaluated_get(depsgraph)).rle_splat
    mode = properties.mode
    if not properties.use_grays or mode == MODES[0] or encoded.is_of(volume_object):
        return own
    low, high = window_of(properties)
    first, last = gray_ends(properties)
    light = [(low + gray * (high - low), float(decode_srgb(first + gray * (last - first)))) for gray in GRAYS]
    opacity, color = [(value, abs(gray - first)) for value, gray in light], [(low, last, last, last)]
    if mode == "minip":
        opacity, color = [(low, 1.0)], [(value, gray, gray, gray) for value, gray in light]
    elif mode == "xray":
        opacity = [(low, 0.0), (high, XRAY_ALPHA)]
    return TransferFunction(name=f"{own.name}, gray", unit=own.unit, opacity=tuple(opacity), color=tuple(color))


def gray_ends(properties) -> tuple[float, float]:
    """The grays of the low and the high end of the window; what absorbs in an X-ray is always white."""
    return (1.0, 0.0) if properties.use_inverted_grays and properties.mode != "xray" else (0.0, 1.0)


def is_dark(properties) -> bool:
    """Whether a volume shows its highest values black, for a white background; reads properties only."""
    if properties.mode != MODES[0] and properties.use_grays:
        return gray_ends(properties)[0] == 1.0
    tree = properties.transfer
    if tree is None or not nodes.is_transfer_tree(tree) or properties.use_shading:
        return False
    return not any(nodes.color_ramp(tree).elements[-1].color[:3])


def evaluate_anew(volume_object) -> None:
    """Update the curves, and tag animated trees, of a volume and its channels after edits by scripts."""
    channels = [row.source for row in volume_object.rle_splat.channels if row.source is not None]
    for one in (volume_object, *channels):
        tree = one.rle_splat.transfer
        if tree is not None and nodes.is_transfer_tree(tree) and tree.is_editable:
            for mapping in filter(None, (nodes.opacity_mapping(tree), nodes.gradient_mapping(tree))):
                mapping.update()
            if any(_is_animated(tree, name) for name in nodes.NODES):
                tree.update_tag()


def _is_animated(tree, name: str) -> bool:
    """Whether keyframes, drivers or NLA strips animate a node of the tree."""
    data = tree.animation_data
    if data is None or data.nla_tracks:
        return data is not None
    return any(curve.data_path.startswith(f'nodes["{name}"]') for curve in (*data.drivers, *curves_of(tree)))


def move_window(volume_object, center: float, width: float, keep_values: bool = False) -> str:
    """Set level and window of a volume object; returns the remark of ``write_transfer``.

    Parameters
    ----------
    center, width : float
        Level and window in physical values.
    keep_values : bool
        Whether to redraw the curves so that every value keeps its color and opacity.
    """
    properties = volume_object.rle_splat
    if not keep_values:
        properties.window_center, properties.window_width = center, width
        return ""
    opacity_scale = properties.opacity_scale
    properties.opacity_scale = 1.0  # so that it is not multiplied into the curve
    before = read_transfer(volume_object)
    remark = write_transfer(volume_object, before, (center - 0.5 * width, center + 0.5 * width))
    properties.opacity_scale = opacity_scale
    return remark


def is_shared(volume_object) -> bool:
    """Whether the node group has other users or is linked, so that edits would affect others or be lost."""
    tree = volume_object.rle_splat.transfer
    return tree.users > 1 or not linked.is_own(tree)


def own_tree(volume_object) -> None:
    """Give the object its own copy of the node group."""
    properties = volume_object.rle_splat
    properties.transfer = linked.own_copy(properties.transfer)
    linked.own_action(properties.transfer)


AUTOMATIC = -1.0  # smoothness
KEYED = (
    "window_center", "window_width", "opacity_scale", "opacity_unit_distance", "ambient", "diffuse", "specular",
    "shininess", "smoothness", "gradient_low", "gradient_high",
)  # fmt: skip


def keyframe(volume_object, frame: float) -> int:
    """Insert keyframes on all values of the transfer function, and return how many there are.

    Blender cannot build the data path of a curve's point, so the paths are written out.
    """
    properties = volume_object.rle_splat
    if not linked.is_own(properties.transfer):
        own_tree(volume_object)
    linked.own_action(volume_object)
    tree = properties.transfer
    for name in KEYED:
        properties.keyframe_insert(name, frame=frame)
    curves = {nodes.OPACITY_NODE: nodes.opacity_mapping(tree)}
    if properties.use_gradient_opacity and nodes.gradient_mapping(tree) is not None:
        curves[nodes.GRADIENT_NODE] = nodes.gradient_mapping(tree)
    paths = [
        f'nodes["{name}"].mapping.curves[0].points[{i}].location'
        for name, mapping in curves.items()
        for i in range(len(mapping.curves[0].points))
    ]
    for i in range(len(nodes.color_ramp(tree).elements)):
        element = f'nodes["{nodes.COLOR_NODE}"].color_ramp.elements[{i}]'
        paths += [f"{element}.position", f"{element}.color"]
    for path in paths:
        tree.keyframe_insert(path, frame=frame)
    return len(KEYED) + len(paths)


def _usable_window(transfer_function, properties) -> tuple[float, float]:
    low, high = transfer_function.span
    if high > low:
        return low, high
    low, high = min(low, properties.value_low), max(high, properties.value_high)
    return (low, high) if high > low else (low - 0.5, low + 0.5)


def _without_inner_repeats(points) -> list:
    """The points without those between the first and the last at a repeated value, which have no effect."""
    return [
        p
        for i, p in enumerate(points)
        if not (0 < i < len(points) - 1 and points[i - 1][0] == p[0] == points[i + 1][0])
    ]


def _cropped(points, low: float, high: float, evaluate) -> list:
    """The points within [low, high], with an added point at an end where the curve continues beyond it."""
    tolerance = 1e-6 * (high - low)
    inside = [p for p in points if low - tolerance <= p[0] <= high + tolerance]

    def height(value):
        return tuple(map(float, evaluate(value).reshape(-1)))

    if points[0][0] < low - tolerance and not (inside and inside[0][0] <= low + tolerance):
        inside.insert(0, (low, *height(low)))
    if points[-1][0] > high + tolerance and not (inside and inside[-1][0] >= high - tolerance):
        inside.append((high, *height(high)))
    return inside or [(low, *height(low))]


def _unit(position: float) -> float:
    return min(1.0, max(0.0, position))
