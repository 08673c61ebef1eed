"""Volume rendering presets of 3D Slicer: ``presets.xml`` and other MRML files, ``.vp`` and ``.vp.json``.

Facts, from Slicer's sources (vtkMRMLVolumePropertyNode, vtkMRMLVolumePropertyStorageNode,
vtkMRMLVolumePropertyJsonStorageNode, volume-property-schema-v1.0.0) and VTK's (vtkVolumeShaderComposer):

- A curve is a text: how many numbers follow, then value and height of each point, or value, red, green and blue.
  A value that is not above the one before it counts as a step at that one.
- ``.vp`` has the same in nine lines: interpolation, shade, diffuse, ambient, specular, specular power, scalar opacity,
  gradient opacity, colors.
- An opacity is per ``scalarOpacityUnitDistance``, 1 mm unless a ``.vp.json`` says otherwise.  That is our opacity unit
  distance.
- Shading is Phong's, of both sides; its highlights become those of Blinn-Phong.  Colors are those of a display.
- A sample's opacity is multiplied by the gradient opacity.  For short steps that multiplies the extinction, as ours
  does.  VTK measures the gradient per mean voxel spacing, we per unit of length.
"""

from xml.parsers import expat

import numpy as np

from ..scene import RleSplatError
from .foreign import FileFunction, display_color, number, scene_linear_points
from .transfer_function import GradientOpacity, Shade, TransferFunction, blinn_shininess

ELEMENT = "VolumeProperty"
DISTANCE = 1.0  # scalarOpacityUnitDistance where a file does not say it
LIGHTING = {"ambient": 0.1, "diffuse": 0.7, "specular": 0.2, "specularPower": 10.0}  # VTK's own defaults
LINES = ("interpolation", "shade", "diffuse", "ambient", "specular", "specularPower", "scalarOpacity",
         "gradientOpacity", "colorTransfer")  # fmt: skip
NEAREST = "0"  # of ``interpolation``
ON_LINE = 1e-6  # how far from the line of its neighbors a point of the gradient opacity may lie
NEAREST_REMARK = "It asks for the value of the nearest voxel, but values are interpolated here."
RAMP_REMARK = (
    "Slicer measures the gradient per mean voxel spacing; here it is per unit of length, so the ends of the gradient "
    "opacity are the same for voxels of 1 mm only."
)
BENT_REMARK = "Midpoints and sharpness of its curves were left out; its points are joined by straight lines."
COMPONENTS_REMARK = "It is for values of several components, of which the first was read."


def read_mrml(content: bytes, what: str) -> list[FileFunction]:
    """Read the volume properties of an MRML file.

    Parameters
    ----------
    content : bytes
        XML. A document type is refused, since entities in it could be anything.
    what : str
        Names the file in messages.

    Returns
    -------
    list of FileFunction
        One for each VolumeProperty element.

    Raises
    ------
    RleSplatError
        If it is not well-formed, or has no VolumeProperty, or one that is incomplete or wrong.
    """
    elements: list[dict] = []

    def refuse(*_declaration):
        raise RleSplatError(f"{what} has a document type (DOCTYPE), which is not read; remove that line.")

    def begin(name, attributes):
        if name == ELEMENT:
            elements.append(attributes)

    parser = expat.ParserCreate()
    parser.StartDoctypeDeclHandler, parser.StartElementHandler = refuse, begin
    try:
        parser.Parse(content, True)
    except (expat.ExpatError, ValueError, LookupError) as problem:  # the latter two for an unknown encoding
        raise RleSplatError(f"{what} is not well-formed XML: {problem}; correct the file.") from None
    if not elements:
        raise RleSplatError(f"{what} has no {ELEMENT} element; choose a file of 3D Slicer's volume rendering presets.")
    return [_property(one, one.get("name") or "", what) for one in elements]


def read_vp(lines: list[str], name: str, what: str) -> list[FileFunction]:
    """Read a volume property file, of one function; RleSplatError if a line is missing or wrong.

    Arguments as of ``color_maps.read_rows``.
    """
    if len(lines) < len(LINES):
        raise RleSplatError(f"{what} ends after {len(lines)} lines, where a .vp file has {len(LINES)}; save it anew.")
    return [_property(dict(zip(LINES, map(str.strip, lines))), name, what)]


def _property(texts: dict, name: str, what: str) -> FileFunction:
    """The transfer function of the texts of one volume property."""
    what = f"{what}, {name!r}" if name else what
    curves = {}
    for key, width in (("scalarOpacity", 2), ("gradientOpacity", 2), ("colorTransfer", 4)):
        if texts.get(key):
            curves[key] = _points(texts[key], width, f"{what}: {key}")
    lighting = {key: number(texts.get(key, default), f"{what}: {key}") for key, default in LIGHTING.items()}
    shades = number(texts.get("shade", 0), f"{what}: shade") != 0.0
    remarks = (NEAREST_REMARK,) if texts.get("interpolation") == NEAREST else ()
    return _build(name, what, curves, lighting if shades else None, DISTANCE, remarks)


def _points(text: str, width: int, what: str) -> list[tuple]:
    """The points of a curve: ``width`` numbers each, with ascending values."""
    words = text.split()
    count = number(words[0], f"The count of {what}")
    if count != len(words) - 1:
        raise RleSplatError(f"{what} announces {count:g} numbers, but {len(words) - 1} follow; correct the file.")
    if count == 0 or count % width:
        raise RleSplatError(f"{what} must have {width} numbers for each point, but has {count:g}; correct the file.")
    numbers = [number(word, f"Each number of {what}") for word in words[1:]]
    points, last = [], numbers[0]
    for i in range(0, len(numbers), width):
        last = max(last, numbers[i])
        points.append((last, *numbers[i + 1 : i + width]))
    return points


def _build(name: str, what: str, curves: dict, lighting: dict | None, distance: float, remarks: tuple) -> FileFunction:
    """The transfer function of points, by the names of LINES; ``lighting`` None: unshaded."""
    for key in ("scalarOpacity", "colorTransfer"):
        if key not in curves:
            raise RleSplatError(f"{what} has no {key}; save the preset anew.")
    colors = [(value, *display_color(rgb, f"{what}: colors")) for value, *rgb in curves["colorTransfer"]]
    steep, more = _gradient_opacity(curves.get("gradientOpacity", ()))
    try:
        shade = None
        if lighting is not None:
            ambient, diffuse, specular, power = (lighting[key] for key in LIGHTING)
            shade = Shade(ambient, diffuse, specular, blinn_shininess(power))
        function = TransferFunction(
            name, None, tuple(curves["scalarOpacity"]), tuple(scene_linear_points(colors)), distance, shade, steep
        )
    except RleSplatError as problem:
        raise RleSplatError(f"{what}: {problem}") from None
    return FileFunction(function, (*remarks, *more))


def _gradient_opacity(points) -> tuple[GradientOpacity | None, tuple]:
    """The curve of a gradient opacity, None where it changes nothing, and remarks.

    Points that the others imply are left out: before 0, on a flat end, on the line of their neighbors.
    """
    if all(height == 1.0 for _, height in points):
        return None, ()
    values, heights = (np.array(one, np.float64) for one in zip(*points))
    if values[0] < 0.0:
        at_zero = np.interp(0.0, values, heights)
        values, heights = np.append(0.0, values[values >= 0.0]), np.append(at_zero, heights[values >= 0.0])
    bent = [
        n for n in range(1, len(values) - 1)
        if abs(np.interp(values[n], values[[n - 1, n + 1]], heights[[n - 1, n + 1]]) - heights[n]) > ON_LINE
        or values[n] in (values[n - 1], values[n + 1])
    ]  # fmt: skip
    kept = [0, *bent, len(values) - 1] if len(values) > 1 else [0]
    while len(kept) > 1 and heights[kept[0]] == heights[kept[1]]:
        kept.pop(0)
    while len(kept) > 1 and heights[kept[-1]] == heights[kept[-2]]:
        kept.pop()
    values, heights = values[kept], heights[kept]
    low, high = values[0], values[-1]
    if low == high and tuple(heights) == (0.0, 1.0):
        return GradientOpacity(low, high), (RAMP_REMARK,)
    if low == high:  # a step between other heights, or a constant
        low, high = 0.0, high or 1.0
    shares = np.clip((values - low) / (high - low), 0.0, 1.0)
    return GradientOpacity(low, high, tuple(zip(shares, np.clip(heights, 0.0, 1.0)))), (RAMP_REMARK,)


# --- .vp.json -------------------------------------------------------------------------------------------------


def read_vp_json(mapping: dict, name: str, what: str) -> list[FileFunction]:
    """Read a volume property file in JSON; RleSplatError if one is incomplete or wrong.

    Parameters
    ----------
    mapping : dict
        With ``volumeProperties``.
    name : str
        Of the transfer functions, which have none in the file.
    what : str
        Names the file in messages.

    Returns
    -------
    list of FileFunction
        One for each volume property.
    """
    properties = _check_type(mapping.get("volumeProperties"), list, f"{what}: volumeProperties")
    if not properties:
        raise RleSplatError(f"{what} has no volume properties; save the preset anew.")
    return [_json_property(one, name, what) for one in properties]


def _check_type(value, kind: type, what: str):
    """``value``, which must be of a type of JSON's."""
    if not isinstance(value, kind):
        form = {list: "a list", dict: "an object"}[kind]
        raise RleSplatError(f"{what} must be {form}; correct the file.")
    return value


def _json_property(one, name: str, what: str) -> FileFunction:
    found = _check_type(one, dict, f"{what}: a volume property")
    components = _check_type(found.get("components"), list, f"{what}: components")
    if not components:
        raise RleSplatError(f"{what} has a volume property without components; save the preset anew.")
    first = _check_type(components[0], dict, f"{what}: a component")
    remarks = (COMPONENTS_REMARK,) if len(components) > 1 else ()
    if one.get("interpolationType") == "nearest":
        remarks = (*remarks, NEAREST_REMARK)
    curves, bent = {}, False
    for key, named in (("scalarOpacity",) * 2, ("gradientOpacity",) * 2, ("colorTransfer", "rgbTransferFunction")):
        if key == "gradientOpacity" and first.get("disableGradientOpacity"):
            continue
        if named in first:
            curves[key], is_bent = _json_points(first[named], f"{what}: {named}")
            bent = bent or is_bent
    given = _check_type(first.get("lighting", {}), dict, f"{what}: lighting")
    lighting = {key: number(given.get(key, default), f"{what}: {key}") for key, default in LIGHTING.items()}
    distance = number(first.get("scalarOpacityUnitDistance", DISTANCE), f"{what}: scalarOpacityUnitDistance")
    remarks = (*remarks, *((BENT_REMARK,) if bent else ()))
    return _build(name, what, curves, lighting if first.get("shade") else None, distance, remarks)


def _json_points(curve, what: str) -> tuple[list[tuple], bool]:
    """The points of a curve in JSON, by ascending values; and whether the file bends it between them."""
    points, bent = [], False
    for one in _check_type(_check_type(curve, dict, what).get("points"), list, f"{what}: points"):
        one = _check_type(one, dict, f"{what}: a point")
        heights = one.get("color", (one.get("y"),))
        if not isinstance(heights, (list, tuple)) or len(heights) not in (1, 3):
            raise RleSplatError(f"{what}: the color of a point must be three numbers; correct the file.")
        points.append(tuple(number(value, f"Each number of {what}") for value in (one.get("x"), *heights)))
        bent = bent or one.get("midpoint", 0.5) != 0.5 or one.get("sharpness", 0.0) != 0.0
    if not points:
        raise RleSplatError(f"{what} has no points; save the preset anew.")
    return sorted(points, key=lambda point: point[0]), bent
