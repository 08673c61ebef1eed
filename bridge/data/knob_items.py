"""The choices of the knobs of quality as enum items, each with its tooltip."""

from ...rle_splat import scene as tables

_TEXTS = {
    "slice": ("Slices", "One layer at each slice of the volume"),
    "slice-2": ("Every Second Slice", "One layer at every second slice; fast and coarse"),
    "simpson": ("Simpson", "Layers at the slices and halfway between them, which count twice, as in Simpson's rule"),
    "gauss2": ("Gauss", "Two layers between neighboring slices, at 21% and 79% of the way, as in Gauss's rule"),
    "nearest": ("Nearest", "Show each voxel as a box"),
    "tent": ("Linear", "Interpolate linearly between voxels"),
    "bspline2": ("Quadratic B-Spline", "Smooth over three voxels"),
    "bspline3": ("Cubic B-Spline", "Smooth over four voxels"),
    "gaussian": ("Gaussian", "Smooth by a bell curve"),
    "off": ("Off", "Show exactly what lies on the ray of each pixel"),
    "widen": ("Widen", "Enlarge voxels that are smaller than a pixel"),
    "bilinear": ("Bilinear", "Linear interpolation of 2 x 2 pixels; fast, a little soft"),
    "keys": ("Cubic, Fast", "Cubic interpolation of 4 x 4 pixels"),
    "cubic": ("Cubic", "Cubic splines through 4 x 4 pixels; the most accurate"),
    "extinction": ("Extinction", "Add the extinctions of voxels that overlap"),
    "opacity": ("Opacity", "Add the opacities of voxels that overlap, as in the original 2003 method"),
}
_COUNTED = {
    "midpoint": ("{} Midpoints", "{} layers between neighboring slices"),
    "preintegrated": (
        "{} Exact Layers",
        "{} layers between neighboring slices, each with the mean color and opacity of all values in it "
        "(pre-integrated)",
    ),
}
RECORD_ITEMS = [
    (str(size), f"{size} Bytes", "Full accuracy" if size == max(tables.RECORDS) else "Less memory and accuracy")
    for size in tables.RECORDS
]


def items(names, later=()) -> list:
    """Enum items of the values of a knob: identifier, label, tooltip and number of each.

    ``later``: names that earlier versions lack.  Their numbers are the last, because .blend files store numbers.
    """
    numbers = {name: number for number, name in enumerate((*(one for one in names if one not in later), *later))}
    return [(name, *_texts(name), numbers[name]) for name in names]


def _texts(name: str) -> tuple[str, str]:
    if name in _TEXTS:
        return _TEXTS[name]
    kind, _, count = name.partition("-")
    label, text = (part.format(count or 1) for part in _COUNTED[kind])
    if count in ("", "1"):
        return label.removesuffix("s"), text.replace("layers", "layer").replace(", each", ",")
    return label, text
