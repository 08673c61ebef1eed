"""Automatic transfer function for a first picture, from the meaning and the distribution of the values."""

import re
from dataclasses import replace

import numpy as np

from ..runtime.steps import drain
from ..scene.checks import refuse_array
from ..volume.histogram import Histogram, histogram_steps, percentile_steps
from ..volume.volume import Volume
from .presets import PRESETS, fit_preset_steps
from .transfer_function import Shade, TransferFunction

BONE_HU = 270.0  # the preset ct-bone shows values from here on
BONE_SHARE = 0.003  # share of the voxels; less is the table or calcium, and soft tissue is more useful
FAINT = 0.02  # alpha below which a voxel is hardly visible
VISIBLE_SHARE = 1e-5  # share of the voxels that must be more than faint for a preset to be accepted
CROWDED_SHARE = 0.9  # share of the voxels; a preset that shows more shows a solid block
FLUORESCENT = 0.2  # of usual opacities, of channels of one file: what lies behind and within shows, and colors add
OUTLIER_FACTOR = 1000.0  # a value this many times the spread of the bulk away from the median is an outlier
BINS = 1024

PRESET_OF_MODALITY = {
    "CT": "ct-bone", "MR": "mr-head", "PT": "pet", "RTDOSE": "isodose", "XA": "xa-limb", "SMOKE": "smoke",
}  # fmt: skip
BRAIN, HEAD = "mr-brain", "mr-head"
EMPTY = 0.9  # share of a face of a scan
ADDED_PET = "pet-hot"  # preset of a PET that is added to another volume
# Words in file names and in names of body parts, as scanners and archives use them.
PRESET_OF_WORD = {
    "ct": "ct-bone", "cbct": "ct-bone", "cta": "ct-angiography",
    "mr": "mr-head", "mri": "mr-head", "t1": "mr-head", "t1w": "mr-head", "t2": "mr-head", "t2w": "mr-head",
    "flair": "mr-brain", "brain": "mr-brain", "mni152": "mr-brain", "mra": "mr-angiography", "tof": "mr-angiography",
    "smoke": "smoke", "fog": "smoke", "cloud": "smoke", "fire": "smoke",
}  # fmt: skip
# Modality, where the file states it -> words that ask for another preset than its usual one.
PRESET_OF_PART = {
    "CT": {"lung": "ct-lung", "lungs": "ct-lung", "cta": "ct-angiography", "angio": "ct-angiography"},
    "MR": {"mra": "mr-angiography", "tof": "mr-angiography", "angio": "mr-angiography", "flair": "mr-brain"},
}
# A word made of a modality and a body part, such as "cthead", counts as two.
JOINED = re.compile(r"(ct|cbct|mr|mri)(head|brain|skull|neck|spine|chest|thorax|lung|heart|abdomen|pelvis|knee|foot)")

# Dark red over salmon and ivory to white, by position between the first visible value (0) and the last (1).
WARM = ((0.0, 0.42, 0.16, 0.10), (0.3, 0.70, 0.36, 0.24), (0.65, 0.87, 0.72, 0.54), (1.0, 0.96, 0.93, 0.88))


def default_transfer_function(volume: Volume) -> tuple[TransferFunction, str]:
    """Choose a transfer function for a volume.

    A preset is chosen if unit, modality or name suggest one and it shows neither nothing nor everything; otherwise a
    transfer function is made from the histogram.

    Parameters
    ----------
    volume : Volume
        The scan that it is to show.

    Returns
    -------
    function : TransferFunction
        In the volume's values.
    remark : str
        One sentence that explains the choice.
    """
    return drain(default_transfer_function_steps(volume))


def default_transfer_function_steps(volume: Volume):
    """Generator of fractions done, of each look at the voxels: ``default_transfer_function``."""
    refuse_array(volume)
    spread = yield from _spread_steps(volume)
    if spread.counts.sum() == 0:
        return _ramp(0.0, 1.0), "The volume holds no finite value; there is nothing to show."
    if volume.value_unit == "signed distance":
        return _inside(volume), "The values are signed distances, so the inside of the surface is shown."
    if volume.color is not None:
        function, _ = _from_histogram(volume, spread)
        opacity = tuple((value, FLUORESCENT * alpha) for value, alpha in function.opacity)
        function = replace(function, opacity=opacity, color=((0.0, *volume.color),), shade=None)
        return function, "The volume is a channel of several, so it is shown in the channel's color."
    has_contrast = yield from _contrast_steps(volume)
    for name, reason in _proposals(volume, spread, has_contrast):
        function, _ = yield from fit_preset_steps(name, volume)
        if VISIBLE_SHARE <= _measure_shown_share(function, spread) <= CROWDED_SHARE:
            return function, f"Preset {PRESETS[name].label}: {reason}."
    return _from_histogram(volume, spread)


def default_channel_function_steps(channel: Volume):
    """Generator of fractions done: as ``default_transfer_function_steps``, for what is added to another volume.

    PET is shown hot instead of black, so that it stands out.
    """
    if channel.modality != "PT":
        return (yield from default_transfer_function_steps(channel))
    function, _ = yield from fit_preset_steps(ADDED_PET, channel)
    return function, f"Preset {PRESETS[ADDED_PET].label}: the channel is a PET."


def _contrast_steps(volume: Volume):
    """Generator of fractions done: whether a volume is a CT with contrast medium in its vessels."""
    if volume.value_unit != "HU":
        return False
    from ..segment.contrast import LEAST_SHARE, contrast_share_steps  # with numba, which looking at a file does without

    return (yield from contrast_share_steps(volume)) >= LEAST_SHARE


def _proposals(volume: Volume, spread: Histogram, has_contrast: bool):
    """Yield (preset, reason) pairs, the most reliable first."""
    words = _words(volume.name)
    for word in words:
        part = PRESET_OF_PART.get(volume.modality, {}).get(word)
        if part is not None:
            part = _of_head(part, volume)
            yield part, f"the modality is {volume.modality} and the name of the volume contains {word}"
    if volume.value_unit == "HU":
        if has_contrast:
            yield "ct-angiography", "vessels are filled with contrast medium"
        bone = spread.counts[spread.centers >= BONE_HU].sum() + spread.above
        if bone >= BONE_SHARE * spread.total:
            yield "ct-bone", "the values are Hounsfield units and include bone"
        # Before ct-soft-tissue, which shows fat and with it the table and the cushions around the patient.
        yield "ct-muscle", "the values are Hounsfield units and include little bone"
        yield "ct-soft-tissue", "the values are Hounsfield units and include little but fat"
    if volume.modality in PRESET_OF_MODALITY:
        yield PRESET_OF_MODALITY[volume.modality], f"the modality of the volume is {volume.modality}"
        return
    for word in words:
        if word in PRESET_OF_WORD:
            yield _of_head(PRESET_OF_WORD[word], volume), f"the name of the volume contains {word}"


def modality_of_name(name: str) -> str | None:
    """The modality of the preset that a word of a name asks for, as where a file does not state it; None without."""
    return next((PRESETS[PRESET_OF_WORD[word]].modality for word in _words(name) if word in PRESET_OF_WORD), None)


def _of_head(name: str, volume: Volume) -> str:
    """A preset; that of a head in place of a brain's, unless the scan's faces are nearly all of one value, as where all
    but the brain was removed.  A head reaches the lowest face with its neck, a brain with its stem at most."""
    if name != BRAIN:
        return name
    faces = [np.take(volume.voxels, end, axis) for axis in range(3) for end in (0, -1)]
    return BRAIN if all(np.mean(face == faces[0].flat[0]) > EMPTY for face in faces) else HEAD


def _words(name: str) -> list[str]:
    """The words of a name in lower case; a modality and a body part in one word are two."""
    found = []
    for word in re.split(r"[^a-z0-9]+", name.lower()):
        joined = JOINED.fullmatch(word)
        found += joined.groups() if joined else (word,)
    return found


def _spread_steps(volume: Volume):
    """Generator of fractions done: a fine histogram over the range of the values without outliers."""
    low, high = volume.value_range
    near, middle, far = (float(p) for p in (yield from percentile_steps(volume, (0.1, 50.0, 99.9))))
    reach = OUTLIER_FACTOR * (far - near)
    if reach > 0.0:
        low = near if middle - low > reach else low
        high = far if high - middle > reach else high
    return (yield from histogram_steps(volume, BINS, (low, high)))


def _measure_shown_share(function: TransferFunction, spread: Histogram) -> float:
    """Share of the voxels that are more than faint."""
    shown = int(spread.counts[function.alpha_at(spread.centers) >= FAINT].sum())
    return shown / max(1, spread.total)


def otsu_threshold(spread: Histogram) -> float:
    """Otsu's threshold: the value that divides the voxels into two classes with the largest variance between them.

    N. Otsu, A threshold selection method from gray-level histograms, 1979.

    Returns
    -------
    float
        Physical value. If a gap makes several values equally good, the middle of the gap.
    """
    weights = spread.counts / spread.counts.sum()
    lower = np.cumsum(weights)[:-1]
    sums = np.cumsum(weights * (spread.centers / _largest(spread)))  # scaled, so that squares cannot overflow
    with np.errstate(divide="ignore", invalid="ignore"):  # an empty class has no mean
        between = (sums[-1] * lower - sums[:-1]) ** 2 / (lower * (1.0 - lower))
    between = np.where(np.isfinite(between), between, 0.0)
    if between.size == 0:
        return float(spread.centers[0])
    best = np.flatnonzero(between >= between.max() * (1.0 - 1e-12))
    return float(0.5 * spread.edges[best[0] + 1] + 0.5 * spread.edges[best[-1] + 1])


def _largest(spread: Histogram) -> float:
    """Largest absolute value of the edges; 1 if that is zero."""
    return float(np.abs(spread.edges).max()) or 1.0


def _surroundings(volume: Volume) -> float:
    """Median physical value on the six faces of the volume, which is what surrounds the object."""
    v = volume.voxels
    faces = np.concatenate([f.ravel() for f in (v[0], v[-1], v[:, 0], v[:, -1], v[:, :, 0], v[:, :, -1])])
    values = volume.physical(faces)
    values = values[np.isfinite(values)]
    return float(np.median(values)) if values.size else volume.value_range[0]


def _from_histogram(volume: Volume, spread: Histogram) -> tuple[TransferFunction, str]:
    """A transfer function that separates the object from its surroundings, and the reason for its range."""
    filled = np.flatnonzero(spread.counts)
    low, high = float(spread.centers[filled[0]]), float(spread.centers[filled[-1]])
    if filled.size == 1:
        least, most = volume.value_range
        low = least if least == most else low  # the middle of the only bin is a little beside it
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
    start = 0.5 * (air + threshold)  # half way to the threshold: above the noise of air, below thin structures
    largest = _largest(spread)
    body = largest * float(np.average(spread.centers[shown] / largest, weights=spread.counts[shown]))
    side = "below" if dark_object else "above"
    reason = f"Unit, name and modality do not say what the volume is, so values {side} {start:.4g} are shown."
    return _curves(start, threshold, body, far), reason


def _curves(start: float, threshold: float, body: float, far: float) -> TransferFunction:
    """Transparent at ``start``, opaque at ``far``, which is above or below, and constant beyond."""
    opacity = [(start, 0.0), (threshold, 0.15), *([(body, 0.45)] if body != far else []), (far, 0.85)]
    color = [(start + t * (far - start), *rgb) for t, *rgb in WARM]
    if far < start:  # points must ascend: reverse the curves
        opacity, color = opacity[::-1], color[::-1]
    return TransferFunction(name="Automatic", opacity=tuple(opacity), color=tuple(color), shade=Shade())


def _ramp(low: float, high: float) -> TransferFunction:
    """Transparent at ``low``, opaque at ``high``."""
    color = tuple((low + t * (high - low), *rgb) for t, *rgb in WARM)
    return TransferFunction(name="Automatic", opacity=((low, 0.0), (high, 0.6)), color=color, shade=Shade())


def _inside(volume: Volume) -> TransferFunction:
    """Opaque below zero, with a transition one voxel wide across the surface of a level set."""
    width = 0.5 * float(volume.spacing.min())
    opacity = ((-width, 0.9), (width, 0.0))
    return TransferFunction(name="Level set", opacity=opacity, color=((0.0, *WARM[2][1:]),), shade=Shade())
