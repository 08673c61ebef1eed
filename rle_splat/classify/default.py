"""A transfer function for a first picture that is never blank, from what the values are and how they are spread."""

from __future__ import annotations

import re

import numpy as np

from ..volume.histogram import Histogram, histogram, percentiles
from ..volume.volume import Volume
from .presets import fit_preset
from .transfer_function import Shade, TransferFunction

BONE_HU = 270.0  # from here on ct-bone shows something
BONE_SHARE = 0.003  # of the voxels; less is table wires and calcium, and soft tissue tells more
FAINT = 0.02  # alpha; a voxel below it hardly shows
VISIBLE_SHARE = 1e-5  # of the voxels have to be more than faint for a preset to count as showing something
CROWDED_SHARE = 0.9  # of the voxels: showing more than this is showing a block
OUTLIER_FACTOR = 1000.0  # a largest value this many times beyond the bulk is an accident, not an object
BINS = 1024

PRESET_OF_MODALITY = {"CT": "ct-bone", "MR": "mr-head", "XA": "xa-limb", "SMOKE": "smoke"}
# Words of file names, as scanners and archives write them.
PRESET_OF_WORD = {
    "ct": "ct-bone", "cbct": "ct-bone", "cthead": "ct-bone", "cta": "ct-angiography",
    "mr": "mr-head", "mri": "mr-head", "mrhead": "mr-head", "mrbrain": "mr-head", "t1": "mr-head", "t1w": "mr-head",
    "t2": "mr-head", "t2w": "mr-head", "flair": "mr-brain", "brain": "mr-brain", "mni152": "mr-brain",
    "mra": "mr-angiography", "tof": "mr-angiography",
    "smoke": "smoke", "fog": "smoke", "cloud": "smoke", "fire": "smoke", "bonsai": "ct-plant", "plant": "ct-plant",
}  # fmt: skip

# Dark red over salmon and ivory to white: by position between the faintest value shown and the highest.
WARM = ((0.0, 0.42, 0.16, 0.10), (0.3, 0.70, 0.36, 0.24), (0.65, 0.87, 0.72, 0.54), (1.0, 0.96, 0.93, 0.88))


def default_transfer_function(volume: Volume) -> tuple[TransferFunction, str]:
    """(a transfer function in the volume's values, one sentence that says why this one).

    A preset is taken where unit, modality or name speak for one and it shows neither nothing nor everything; else
    one is made from the histogram.  Only a volume without any finite value stays blank.
    """
    spread = _spread(volume)
    if spread.counts.sum() == 0:
        return _ramp(0.0, 1.0), "The volume holds no finite value, so there is nothing to show."
    if volume.value_unit == "signed distance":
        return _inside(volume), "The values are signed distances, so what lies inside the surface is shown."
    for name, reason in _proposals(volume, spread):
        function, _ = fit_preset(name, volume)
        if VISIBLE_SHARE <= _shown_share(function, spread) <= CROWDED_SHARE:
            return function, f"The preset {name} was chosen, since {reason}."
    return _from_histogram(volume, spread)


def _proposals(volume: Volume, spread: Histogram):
    """(preset, reason) pairs, the best founded first."""
    if volume.value_unit == "HU":
        bone = spread.counts[spread.centers >= BONE_HU].sum() + spread.above
        if bone >= BONE_SHARE * spread.total:
            yield "ct-bone", "the values are Hounsfield units and there is bone among them"
        yield "ct-soft-tissue", "the values are Hounsfield units and there is little bone among them"
    words = [word for word in re.split(r"[^a-z0-9]+", volume.name.lower()) if word in PRESET_OF_WORD]
    for word in words:
        yield PRESET_OF_WORD[word], f"the name of the volume says {word}"
    if volume.modality in PRESET_OF_MODALITY:
        yield PRESET_OF_MODALITY[volume.modality], f"the volume is of the kind {volume.modality}"


def _spread(volume: Volume) -> Histogram:
    """A fine histogram over the range of the values, without accidental outliers."""
    low, high = volume.value_range
    near, middle, far = (float(p) for p in percentiles(volume, (0.1, 50.0, 99.9)))
    reach = OUTLIER_FACTOR * (far - near)
    if reach > 0.0:
        low = near if middle - low > reach else low
        high = far if high - middle > reach else high
    return histogram(volume, BINS, (low, high))


def _shown_share(function: TransferFunction, spread: Histogram) -> float:
    shown = int(spread.counts[function.alpha_at(spread.centers) >= FAINT].sum())
    return shown / max(1, spread.total)


def otsu_threshold(spread: Histogram) -> float:
    """The value that parts the voxels into two classes with the largest variance between them (Otsu 1979).

    Where a gap makes many values equally good, the middle of the gap.
    """
    weights = spread.counts / spread.counts.sum()
    lower = np.cumsum(weights)[:-1]
    sums = np.cumsum(weights * (spread.centers / _largest(spread)))  # their squares would leave float64's range
    with np.errstate(divide="ignore", invalid="ignore"):  # an empty class has no mean
        between = (sums[-1] * lower - sums[:-1]) ** 2 / (lower * (1.0 - lower))
    between = np.where(np.isfinite(between), between, 0.0)
    if between.size == 0:
        return float(spread.centers[0])
    best = np.flatnonzero(between >= between.max() * (1.0 - 1e-12))
    return float(0.5 * spread.edges[best[0] + 1] + 0.5 * spread.edges[best[-1] + 1])


def _largest(spread: Histogram) -> float:
    """The size of the value furthest from zero, 1 if that is zero."""
    return float(np.abs(spread.edges).max()) or 1.0


def _surroundings(volume: Volume) -> float:
    """The median physical value on the six faces of the volume: what surrounds the object."""
    v = volume.voxels
    faces = np.concatenate([f.ravel() for f in (v[0], v[-1], v[:, 0], v[:, -1], v[:, :, 0], v[:, :, -1])])
    values = volume.physical(faces)
    values = values[np.isfinite(values)]
    return float(np.median(values)) if values.size else volume.value_range[0]


def _from_histogram(volume: Volume, spread: Histogram) -> tuple[TransferFunction, str]:
    filled = np.flatnonzero(spread.counts)
    low, high = float(spread.centers[filled[0]]), float(spread.centers[filled[-1]])
    if filled.size == 1:
        function = _ramp(low - max(1.0, abs(low)), low)
        return function, f"All values are about {low:g}, so everything is shown."
    threshold = otsu_threshold(spread)
    above = spread.centers > threshold
    around = _surroundings(volume)
    dark_object = around > threshold and spread.counts[above].sum() > spread.counts[~above].sum()
    if dark_object:
        shown, air, far = ~above, min(around, high), low
    else:
        shown, air, far = above, max(low, min(around, threshold)), high
    start = 0.5 * (air + threshold)  # half way to the threshold: past the noise of the air, before thin structures
    largest = _largest(spread)
    body = largest * float(np.average(spread.centers[shown] / largest, weights=spread.counts[shown]))
    side = "below" if dark_object else "above"
    reason = f"Neither unit nor name nor modality tell what it is, so values {side} {start:.4g} are shown."
    return _curves(start, threshold, body, far), reason


def _curves(start: float, threshold: float, body: float, far: float) -> TransferFunction:
    """Transparent at ``start``, solid at ``far`` on either side of it, and held beyond."""
    opacity = [(start, 0.0), (threshold, 0.15), *([(body, 0.45)] if body != far else []), (far, 0.85)]
    color = [(start + t * (far - start), *rgb) for t, *rgb in WARM]
    if far < start:  # ascending values: the same curves read from the other end
        opacity, color = opacity[::-1], color[::-1]
    return TransferFunction(name="Automatic", opacity=tuple(opacity), color=tuple(color), shade=Shade())


def _ramp(low: float, high: float) -> TransferFunction:
    color = tuple((low + t * (high - low), *rgb) for t, *rgb in WARM)
    return TransferFunction(name="Automatic", opacity=((low, 0.0), (high, 0.6)), color=color, shade=Shade())


def _inside(volume: Volume) -> TransferFunction:
    """Solid below zero, with one voxel of transition across the surface of a level set."""
    width = 0.5 * float(volume.spacing.min())
    opacity = ((-width, 0.9), (width, 0.0))
    return TransferFunction(name="Level set", opacity=opacity, color=((0.0, *WARM[2][1:]),), shade=Shade())
