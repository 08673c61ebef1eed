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
    center, width = map(typed, own(properties))
    return center - 0.5 * width, center + 0.5 * width, properties.slices_clear_black


def own(properties) -> tuple[float, float]:
    """Level and window of a volume's slices."""
    if properties.slices_follow_window:
        return properties.window_center, properties.window_width
    return properties.slice_center, properties.slice_width


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
    if properties.slices_follow_window:
        properties.window_center, properties.window_width = center, width
    else:
        properties.slice_center, properties.slice_width = center, width
