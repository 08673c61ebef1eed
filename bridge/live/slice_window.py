"""The window of a volume's slices: their own, or that of the volume's colors."""

from ...rle_splat.runtime.steps import drain
from ...rle_splat.volume.histogram import percentile_steps
from .. import linked
from ..data.decimals import typed
from ..look.preset_entries import modality_of

SOFT_TISSUE = 50.0, 400.0  # level and window in HU
PERCENTS = 1.0, 99.5  # of the values that other scans show black and white: single bright vessels do not darken all


def read(properties) -> tuple[float, float, bool]:
    """The window of a volume's slices.

    Returns
    -------
    low, high : float
        Physical values shown black and white.
    clears : bool
        Whether black is transparent.
    """
    center, width = map(typed, level_and_window(properties))
    return center - 0.5 * width, center + 0.5 * width, properties.slices_clear_black


def names(properties, of_slices: bool = True) -> tuple[str, str]:
    """The properties that hold level and window of a volume's slices, or of its colors."""
    is_own = of_slices and not properties.slices_follow_window
    return ("slice_center", "slice_width") if is_own else ("window_center", "window_width")


def level_and_window(properties, of_slices: bool = True) -> tuple[float, float]:
    """Level and window of a volume's slices, or of its colors."""
    center, width = names(properties, of_slices)
    return getattr(properties, center), getattr(properties, width)


def begin(properties, volume) -> None:
    """Give a volume's first slices a window of their own: soft tissue for CT, else by the values.

    A window that was set before stays, as does one whose edits would be lost.
    """
    if linked.why_not_editable(properties.id_data):
        return
    if properties.is_property_set("slices_follow_window") or properties.is_property_set("slice_width"):
        return
    if modality_of(properties) == "CT":
        properties.slice_center, properties.slice_width = SOFT_TISSUE
    else:
        low, high = map(float, drain(percentile_steps(volume, PERCENTS)))
        properties.slice_center, properties.slice_width = 0.5 * (low + high), max(high - low, 1e-6)
    properties.slices_follow_window = False


def move(properties, center: float, width: float) -> None:
    """Set the window of a volume's slices, which is then their own unless it is the volume's."""
    for name, value in zip(names(properties), (center, width)):
        setattr(properties, name, value)
