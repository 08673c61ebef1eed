"""Appearance of labels: hidden, in one color or opacity, by a preset or by a transfer function."""

import colorsys
from collections.abc import Sequence
from dataclasses import dataclass, replace

from ..runtime.steps import drain
from ..scene import Labels, RleSplatError, as_float, from_mapping, read_json
from ..segment.label_map import BACKGROUND, MOST_LABELS, value_steps
from ..volume.volume import Volume
from .presets import fit_preset, preset
from .transfer_function import TransferFunction

SOLID_VOXELS = 10.0  # thickness to which the opacity of a solid label refers, in voxels of the smallest spacing


def distinct_color(number: int) -> tuple:
    """A scene-linear color; hues of numbers that follow one another are apart by the golden ratio."""
    return colorsys.hsv_to_rgb(number * 0.618034 % 1.0, 0.75, 0.8)


@dataclass(frozen=True)
class LabelStyle:
    """Appearance of one label, for ``style_labels``.

    Parameters
    ----------
    label : int
        Value of the label's voxels.
    name : str
        Name for display.
    hidden : bool
        Whether voxels of the label are transparent.
    color : (3,) sequence of float or None
        Scene-linear RGB that replaces the colors of the transfer function.
    preset : str or None
        Preset that is fitted to the volume and replaces its transfer function.
    transfer_function : TransferFunction, dict or None
        Transfer function that replaces the volume's.
    opacity : float
        Factor on the opacities, 0 to 1.
    solid : bool
        Whether all voxels of the label have the same opacity, whatever their values: ``opacity`` per ten times
        the smallest spacing, and 1 is opaque.

    Raises
    ------
    RleSplatError
        If a value is of the wrong type or range, or both a preset and a transfer function are given.
    """

    label: int
    name: str = ""
    hidden: bool = False
    color: Sequence[float] | None = None
    preset: str | None = None
    transfer_function: TransferFunction | None = None
    opacity: float = 1.0
    solid: bool = False

    def __post_init__(self):
        what = f"Label {self.label!r}"
        if isinstance(self.label, bool) or not isinstance(self.label, int):
            raise RleSplatError(f"A label must be a whole number, not {self.label!r}.")
        if not (isinstance(self.name, str) and isinstance(self.hidden, bool) and isinstance(self.solid, bool)):
            raise RleSplatError(f"{what}: name must be text, and hidden and solid must be true or false.")
        opacity = as_float(self.opacity)
        if not 0.0 <= opacity <= 1.0:
            raise RleSplatError(f"{what}: opacity must be from 0 to 1, not {self.opacity!r}.")
        object.__setattr__(self, "opacity", opacity)
        if self.color is not None:
            color = tuple(map(as_float, self.color)) if isinstance(self.color, (list, tuple)) else ()
            if len(color) != 3 or not all(0.0 <= c < float("inf") for c in color):
                raise RleSplatError(f"{what}: color must be three finite numbers, none below zero.")
            object.__setattr__(self, "color", color)
        if self.preset is not None and self.transfer_function is not None:
            raise RleSplatError(f"{what} has a preset and a transfer function; give only one of them.")
        if self.preset is not None:
            preset(self.preset)
        if isinstance(self.transfer_function, dict):
            object.__setattr__(self, "transfer_function", TransferFunction.from_json(self.transfer_function))

    def function(self, volume: Volume, own: TransferFunction) -> TransferFunction | None:
        """Transfer function of the label on ``volume``, whose own is ``own``; None if the label is hidden."""
        if self.hidden:
            return None
        found = self.transfer_function or own
        if self.preset is not None:
            found = fit_preset(self.preset, volume)[0]
        if self.solid:
            thickness = SOLID_VOXELS * float(volume.spacing.min())
            flat = ((0.0, self.opacity),)
            found = replace(found, opacity=flat, opacity_unit_distance=thickness, gradient_opacity=None)
        elif self.opacity != 1.0:
            found = replace(found, opacity=tuple((value, self.opacity * alpha) for value, alpha in found.opacity))
        return found if self.color is None else replace(found, color=((0.0, *self.color),))


def read_label_styles(path) -> tuple[LabelStyle, ...]:
    """Read the appearance of labels from a JSON file.

    Parameters
    ----------
    path : str or Path
        File with a list of objects; their keys are the parameters of LabelStyle.

    Raises
    ------
    RleSplatError
        If the file cannot be read or names a label twice.
    """
    entries = read_json(path, "the label file")
    if not isinstance(entries, list):
        raise RleSplatError(f"The label file {path} must hold a list of labels, one object for each.")
    found = tuple(from_mapping(LabelStyle, entry, "A label of the label file") for entry in entries)
    if len({style.label for style in found}) < len(found):
        raise RleSplatError(f"The label file {path} lists a label twice; list each label once.")
    return found


def default_styles(labels) -> tuple[LabelStyle, ...]:
    """The styles of a label map (a Volume) by what its file says.

    These are the names and colors of the file. In a map without names, such as of nuclei, each label is solid and has a
    color of its own, and 0 is hidden.
    """
    Labels(labels)  # checks for whole numbers
    if labels.named_labels:
        return tuple(LabelStyle(one.label, one.name, color=one.color) for one in labels.named_labels)
    numbers = drain(value_steps(labels))
    if len(numbers) > MOST_LABELS:
        raise RleSplatError(
            f"The label map {labels.name} has more than {MOST_LABELS} different values; choose another file, or give "
            "the styles of its labels."
        )
    return tuple(
        LabelStyle(int(n), hidden=bool(n == BACKGROUND), color=distinct_color(int(n)), solid=True) for n in numbers
    )


def style_labels(
    labels: Volume, volume: Volume, transfer_function: TransferFunction, styles: Sequence[LabelStyle] | None = None,
    smooth: bool = True,
) -> Labels:  # fmt: skip
    """Make the Labels of a scene of a label map, as ``rle-splat render --labels`` shows them.

    Parameters
    ----------
    labels : Volume
        Label map on the grid of ``volume``, such as the result of ``read_labels``.
    volume : Volume
        The scan.
    transfer_function : TransferFunction
        That of the scene.
    styles : sequence of LabelStyle, optional
        Labels without a style look like the scan, and so does a style that has only a name. By default, labels have the
        names and colors in their file. In a map without names, such as of nuclei, each label is solid and has a color
        of its own, and 0 is hidden.
    smooth : bool
        Whether edges of labels are smooth.

    Returns
    -------
    Labels
        For ``Scene.labels``.

    Raises
    ------
    RleSplatError
        If the voxels are not whole numbers, a style is none, or a map without names has more than 512 different values.
    """
    styles = default_styles(labels) if styles is None else tuple(styles)
    if not all(isinstance(style, LabelStyle) for style in styles):
        raise RleSplatError("The styles of labels must be LabelStyle, such as LabelStyle(5, color=(1.0, 0.0, 0.0)).")
    changed = {style.label: style.function(volume, transfer_function) for style in styles}
    functions = {
        label: function
        for label, function in changed.items()
        if function is None or function.key != transfer_function.key
    }
    return Labels(labels, functions, {style.label: style.name for style in styles if style.name}, smooth)
