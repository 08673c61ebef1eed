"""The node group that stores the colors and the opacity curve of a transfer function, over positions 0 to 1.

A property group cannot own a color ramp or a curve.  So both are stored in nodes of a shader node group, which Blender
saves, undoes, appends and animates like other data.  The group is never used in a material.
"""

from itertools import pairwise

import bpy
import numpy as np

from ...rle_splat.classify.transfer_function import RAMP

COLOR_NODE = "Color"
OPACITY_NODE = "Opacity"
GRADIENT_NODE = "Gradient Opacity"  # which groups of earlier versions lack
NODES = (OPACITY_NODE, COLOR_NODE, GRADIENT_NODE)
_KINDS = {COLOR_NODE: "ShaderNodeValToRGB", OPACITY_NODE: "ShaderNodeFloatCurve"}
MARK = "rle_splat_transfer"
MOST_STOPS = 32  # Blender's limit on the stops of a color ramp
# A repeated position is a step.  Blender may swap points at the same position when it sorts them, so the second point
# is stored this far to the right: thirty times the spacing of float32 below 1, 1/500 of a 12-bit gray level.
STEP = 2e-6
TABLE = 256  # intervals of the lookup table by which Blender evaluates a curve


def is_transfer_tree(tree) -> bool:
    """Whether a node tree is a complete transfer function."""
    return is_marked(tree) and not missing_nodes(tree)


def is_marked(tree) -> bool:
    """Whether a tree was made for a transfer function, even if the user has deleted some of its nodes."""
    return bool(tree.get(MARK))


def missing_nodes(tree) -> list[str]:
    """Names of the nodes that a transfer function needs and the tree lacks."""
    return [name for name, kind in _KINDS.items() if name not in tree.nodes or tree.nodes[name].bl_idname != kind]


def new_tree(name: str):
    """Create a node group with default nodes; the leading dot in its name hides it from menus."""
    tree = bpy.data.node_groups.new(f".RLE Splat {name}", "ShaderNodeTree")
    tree[MARK] = True
    for label, kind in _KINDS.items():
        node = tree.nodes.new(kind)
        node.name = node.label = label
    add_gradient_node(tree)
    return tree


def add_gradient_node(tree) -> None:
    """Give a node group the curve of its gradient opacity, a ramp, if it has none."""
    if GRADIENT_NODE not in tree.nodes:
        node = tree.nodes.new(_KINDS[OPACITY_NODE])
        node.name = node.label = GRADIENT_NODE
        write_curve(node.mapping, RAMP)


def color_ramp(tree):
    """The color ramp of a transfer function's node tree."""
    return tree.nodes[COLOR_NODE].color_ramp


def opacity_mapping(tree):
    """The curve mapping of the opacity of a transfer function's node tree."""
    return tree.nodes[OPACITY_NODE].mapping


def gradient_mapping(tree):
    """The curve mapping of the gradient opacity of a transfer function's node tree; None of an earlier version's."""
    return tree.nodes[GRADIENT_NODE].mapping if GRADIENT_NODE in tree.nodes else None


def steps_apart(positions) -> list[float]:
    """Separate equal positions by STEP: the second of two is moved right, or at 1 the first is moved left.

    The positions are in [0, 1] and ascend, and at most two of them are equal.
    """
    apart = [float(p) for p in positions]
    for i in range(1, len(apart)):
        if apart[i] - apart[i - 1] < STEP:
            if apart[i] + STEP > 1.0:
                apart[i - 1], apart[i] = 1.0 - STEP, 1.0
            else:
                apart[i] = apart[i - 1] + STEP
    return apart


def steps_together(positions) -> list[float]:
    """The inverse of ``steps_apart``: positions closer than 1.5 STEP become equal."""
    together = [float(p) for p in positions]
    for i in range(1, len(together)):
        if together[i] - together[i - 1] < 1.5 * STEP:
            shared = 1.0 if together[i] >= 1.0 else together[i - 1]
            together[i - 1] = together[i] = shared
    return together


def write_curve(mapping, points) -> None:
    """Replace the points of a curve, (position, height), which straight lines connect.

    Positions are in [0, 1] and ascend.
    """
    if len(points) == 1:
        points = ((0.0, points[0][1]), (1.0, points[0][1]))
    curve = mapping.curves[0]
    while len(curve.points) > 2:
        curve.points.remove(curve.points[1])
    positions = steps_apart([p for p, _ in points])
    # The two end points are placed first, so that points added between them keep their order.
    curve.points[0].location = (positions[0], points[0][1])
    curve.points[-1].location = (positions[-1], points[-1][1])
    for position, (_, height) in zip(positions[1:-1], points[1:-1]):
        curve.points.new(position, height)
    for point in curve.points:
        point.handle_type = "VECTOR"
        point.select = False
    mapping.extend = "HORIZONTAL"
    mapping.update()


def read_curve(mapping) -> list[tuple[float, float]]:
    """Read a curve as a polyline of (position, height).

    It has the control points, and samples of Blender's table between points that do not have vector handles.
    """
    mapping.initialize()
    curve = mapping.curves[0]
    own = [(float(p.location[0]), float(p.location[1]), p.handle_type) for p in curve.points]
    own.sort(key=lambda point: point[0])
    positions = steps_together([point[0] for point in own])
    points = []
    for i, (position, (_, height, handle)) in enumerate(zip(positions, own)):
        points.append((position, height))
        if i + 1 == len(own) or (handle == "VECTOR" and own[i + 1][2] == "VECTOR"):
            continue
        for sample in _between(position, positions[i + 1]):
            points.append((sample, float(mapping.evaluate(curve, sample))))
    return points


def write_ramp(ramp, points) -> None:
    """Replace the stops of a color ramp, (position, r, g, b), between which it is linear.

    There are at most MOST_STOPS; positions are in [0, 1] and ascend.
    """
    ramp.color_mode = "RGB"
    ramp.interpolation = "LINEAR"
    while len(ramp.elements) > 1:
        ramp.elements.remove(ramp.elements[-1])
    positions = steps_apart([p[0] for p in points])
    ramp.elements[0].position = positions[0]
    ramp.elements[0].color = (*points[0][1:], 1.0)
    for position, (_, *rgb) in zip(positions[1:], points[1:]):
        ramp.elements.new(position).color = (*rgb, 1.0)


def read_ramp(ramp) -> list[tuple[float, float, float, float]]:
    """Points whose straight joins in linear RGB are the ramp; smooth modes are sampled TABLE times."""
    stops = sorted(((float(e.position), *map(float, e.color[:3])) for e in ramp.elements), key=lambda s: s[0])
    positions = steps_together([stop[0] for stop in stops])
    stops = [(position, *stop[1:]) for position, stop in zip(positions, stops)]
    if ramp.color_mode == "RGB" and ramp.interpolation == "LINEAR":
        return stops
    if ramp.interpolation == "CONSTANT":
        points = stops[:1]
        for left, right in pairwise(stops):
            points += [(right[0], *left[1:]), right]
        return points
    return [(p, *map(float, ramp.evaluate(p)[:3])) for p in np.linspace(0.0, 1.0, TABLE + 1).tolist()]


def fewest_stops(points) -> list[int]:
    """Choose color points whose polyline stays close to all of them.

    Greedy: the point farthest from the polyline through the chosen ones is added next.

    Parameters
    ----------
    points : sequence of (value, r, g, b)
        Color points in ascending order.

    Returns
    -------
    list of int
        Ascending indices of the chosen points, both ends included.
    """
    if len(points) <= MOST_STOPS:
        return list(range(len(points)))
    table = np.array(points, dtype=np.float64)
    chosen = [0, len(points) - 1]
    while len(chosen) < MOST_STOPS:
        chosen.sort()
        error = np.max(
            [np.abs(np.interp(table[:, 0], table[chosen, 0], table[chosen, c]) - table[:, c]) for c in (1, 2, 3)],
            axis=0,
        )
        error[chosen] = -1.0
        chosen.append(int(np.argmax(error)))
    return sorted(chosen)


def _between(left: float, right: float) -> list[float]:
    """Positions of Blender's table strictly between two control points."""
    first, last = int(np.floor(left * TABLE)) + 1, int(np.ceil(right * TABLE)) - 1
    return [i / TABLE for i in range(first, last + 1) if left < i / TABLE < right]
