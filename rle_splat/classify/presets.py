"""Built-in transfer functions, one JSON file each in ``presets/``, and how they are fitted to a volume."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..runtime.steps import drain
from ..scene import RleSplatError
from ..scene.checks import refuse_array
from ..volume.histogram import percentile_steps
from ..volume.hounsfield import AIR
from ..volume.volume import Volume
from .transfer_function import TransferFunction

FOLDER = Path(__file__).parent / "presets"
RELATIVE = "relative"  # unit of points from 0 to 1 that are to be moved to the values of a volume
MAXIMUM = "maximum"  # unit of points that are shares of the largest value
FIT_PERCENTS = (1.0, 99.9)  # percentiles of the values, to which the ends of a preset's points are moved
SMOOTHED = 2.0  # voxels: the largest smoothness of a preset


@dataclass(frozen=True)
class Preset:
    """One built-in transfer function.

    Attributes
    ----------
    name : str
        Name on the command line.
    label, description : str
        Texts for display.
    modality : str or None
        Modality for which the preset is made.
    """

    name: str
    label: str
    modality: str | None
    description: str

    @property
    def path(self) -> Path:
        """The JSON file."""
        return FOLDER / f"{self.name}.json"


_ROWS = (
    Preset("ct-bone", "CT Bone", "CT", "bone only, ivory and opaque"),
    Preset("ct-soft-tissue", "CT Soft Tissue", "CT", "translucent fat and muscle, with the bones inside"),
    Preset("ct-skin", "CT Skin", "CT", "the surface of the body"),
    Preset("ct-skin-and-bone", "CT Skin, Bone", "CT", "bones under a thin veil of skin"),
    Preset("ct-muscle", "CT Muscle", "CT", "muscle and organs without fat"),
    Preset("ct-lung", "CT Lung", "CT", "airways, lungs and their vessels"),
    Preset("ct-angiography", "CT Angio", "CT", "vessels filled with contrast medium, with bone"),
    Preset("ct-heart", "CT Heart", "CT", "heart muscle and chambers filled with contrast medium"),
    Preset(
        "ct-coronaries",
        "CT Coronaries",
        "CT",
        "filled vessels in a transparent heart; calcium is white above 700 HU, else colored as vessels",
    ),
    Preset("ct-liver", "CT Liver", "CT", "a transparent liver with its veins, about 70 s after contrast medium"),
    Preset("ct-industrial", "CT Industrial", "CT", "parts of machines in gray, brighter where they are denser"),
    Preset("ct-botanical", "CT Botanical", "CT", "leaves, stems and wood of plants"),
    Preset("ct-specimen", "CT Specimen", "CT", "a specimen of soft and hard parts, from red to ivory"),
    Preset("mr-head", "MR Head", "MR", "the head from outside; cut faces show the inside; sets Smoothness to 1.6 mm"),
    Preset("mr-brain", "MR Brain", "MR", "gray and white matter of a brain without skull; sets Smoothness to 1.6 mm"),
    Preset("mr-angiography", "MR Angio", "MR", "bright vessels"),
    Preset("mr-mip", "MR MIP", "MR", "bright vessels in gray, for MIP"),
    Preset("faint", "Faint", None, "everything, faintly, unshaded, like a radiograph"),
    Preset("gray", "Gray", None, "a gray window over all values, for MIP, MinIP and average"),
    Preset("xa-limb", "C-Arm Limb", "XA", "bones in soft tissue, from a rotational X-ray of a C-arm"),
    Preset("smoke", "Smoke", "SMOKE", "gray smoke from thin to dense"),
    Preset("pet", "PET", "PT", "uptake in inverted gray, black from SUV 10 on, for a white background"),
    Preset(
        "pet-hot", "PET Hot", "PT", "uptake above SUV 1.5 from dark red to pale yellow, over a CT or a dark background"
    ),
    Preset("isodose", "Isodose", "RTDOSE", "steps of a dose at 30, 50, 70, 80, 90 and 95% of its maximum"),
)
PRESETS = {row.name: row for row in _ROWS}


def preset_names() -> tuple[str, ...]:
    """The names of the built-in transfer functions, which ``preset`` and ``fit_preset`` take.

    Returns
    -------
    tuple of str
        Such as "ct-bone".
    """
    return tuple(PRESETS)


def preset(name: str) -> TransferFunction:
    """Load a built-in transfer function.

    Parameters
    ----------
    name : str
        One of ``preset_names()``, such as "ct-bone".

    Returns
    -------
    TransferFunction
        In the preset's own values. Points of a preset without unit run from 0 to 1; fit them with ``fit_preset``.

    Raises
    ------
    RleSplatError
        If there is no such preset; the message lists the names.
    """
    if name not in PRESETS:
        raise RleSplatError(f"There is no preset {name!r}; choose one of {', '.join(PRESETS)}.")
    return TransferFunction.from_json(PRESETS[name].path)


def _typical_range_steps(volume: Volume):
    """Generator of fractions done: the range of typical values of a volume, (low, high), physical.

    This is the 1st to 99.9th percentile, of HU from -1030 at least; if they coincide, the whole range; for a constant
    volume, the unit interval below its value, so that the upper end of a transfer function applies to it.
    """
    low, high = (float(p) for p in (yield from percentile_steps(volume, FIT_PERCENTS)))
    if volume.value_unit == "HU" and low < AIR[0] < high:
        low = AIR[0]  # beyond a scanner's field of view lower values are stored
    if low == high:
        low, high = volume.value_range
    if low == high:
        low = min(low - 1.0, float(np.nextafter(low, -np.inf)))
    return low, high


def fit_preset(name: str, volume: Volume) -> tuple[TransferFunction, str | None]:
    """Fit a built-in transfer function to a volume.

    A preset in the volume's own unit is not changed. The points of any other preset are moved linearly, so that they
    run from the 1st to the 99.9th percentile of the volume's values (of HU from -1030 at least), or, as shares of the
    largest value, from 0 to it.  Its smoothness is at most twice the largest spacing, for small animals.

    Parameters
    ----------
    name : str
        One of ``preset_names()``, such as "ct-bone".
    volume : Volume
        The scan that it is to show.

    Returns
    -------
    function : TransferFunction
        In the volume's values.
    remark : str or None
        A sentence if the points were moved.

    Raises
    ------
    RleSplatError
        If there is no preset of this name.
    """
    return drain(fit_preset_steps(name, volume))


def fit_preset_steps(name: str, volume: Volume):
    """Generator of fractions done: ``fit_preset``."""
    refuse_array(volume)
    function = preset(name)
    if function.unit is not None and function.unit == volume.value_unit:
        return function, None
    fitted, remark = yield from fit_steps(function, volume)
    shade, most = fitted.shade, SMOOTHED * float(volume.spacing.max())
    if shade is not None and shade.smoothness is not None and shade.smoothness > most:
        fitted = replace(fitted, shade=replace(shade, smoothness=most))
    return fitted, remark


def fit_steps(function: TransferFunction, volume: Volume):
    """Generator of fractions done: move the points of a transfer function to the values of a volume.

    Returns
    -------
    function : TransferFunction
        Its points run from the 1st to the 99.9th percentile of the volume's values, or from 0 to the largest one.
    remark : str
        A sentence that says so.
    """
    if function.unit == MAXIMUM and volume.value_range[1] > 0.0:
        most = volume.value_range[1]
        remark = f"The points of the preset {function.name} are shares of the largest value, {most:g}."
        return function.remapped(0.0, most, unit=volume.value_unit), remark
    low, high = yield from _typical_range_steps(volume)
    has_unit = function.unit not in (None, RELATIVE)
    meant = f", whose points are in {function.unit}," if has_unit else ""
    remark = f"{function.name}{meant} was fitted to {low:g} to {high:g}, the 1st to 99.9th percentile of the values."
    return function.remapped(low, high, unit=volume.value_unit), remark
