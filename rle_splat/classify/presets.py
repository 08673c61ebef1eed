"""The built-in transfer functions, one JSON file each in ``presets/``, and how they are fitted to a volume."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..scene import RleSplatError
from ..volume.histogram import percentiles
from ..volume.volume import Volume
from .transfer_function import TransferFunction

FOLDER = Path(__file__).parent / "presets"
FIT_PERCENTS = (1.0, 99.9)  # of the values; the ends of a preset's points are moved there


@dataclass(frozen=True)
class Preset:
    """A row of the table: ``name`` as typed, ``label`` and ``description`` as shown, and the modality it is for."""

    name: str
    label: str
    modality: str | None
    description: str

    @property
    def path(self) -> Path:
        return FOLDER / f"{self.name}.json"


_ROWS = (
    Preset("ct-bone", "CT Bone", "CT", "bone alone, ivory and opaque"),
    Preset("ct-soft-tissue", "CT Soft Tissue", "CT", "translucent fat and muscle, with the bones inside"),
    Preset("ct-skin", "CT Skin", "CT", "the surface of the body"),
    Preset("ct-skin-and-bone", "CT Skin and Bone", "CT", "bones under a thin veil of skin"),
    Preset("ct-muscle", "CT Muscle", "CT", "muscle and organs without fat"),
    Preset("ct-lung", "CT Lung", "CT", "airways, lungs and their vessels"),
    Preset("ct-angiography", "CT Angiography", "CT", "vessels filled with contrast medium, with bone"),
    Preset("ct-industrial", "CT Industrial", "CT", "grey metal parts with bright dense inserts"),
    Preset("ct-plant", "CT Plant", "CT", "leaves, wood and pot"),
    Preset("ct-specimen", "CT Specimen", "CT", "shell and flesh of a small animal"),
    Preset("mr-head", "MR Head", "MR", "the head from outside; cut faces show what is inside"),
    Preset("mr-brain", "MR Brain", "MR", "grey and white matter of a brain without its skull"),
    Preset("mr-angiography", "MR Angiography", "MR", "bright vessels"),
    Preset("x-ray", "X-Ray", None, "everything, faintly, unshaded, like a radiograph"),
    Preset("window", "Window", None, "a grey window over all values, for MIP, MinIP and average"),
    Preset("xa-limb", "X-Ray Limb", "XA", "bones in flesh, from a rotational X-ray"),
    Preset("smoke", "Smoke", "SMOKE", "grey smoke from thin to dense"),
)
PRESETS = {row.name: row for row in _ROWS}


def preset(name: str) -> TransferFunction:
    """The built-in transfer function called ``name``, in its own values; RleSplatError lists the names there are.

    Points of a preset without unit run from 0 to 1 and mean nothing until they are fitted to a volume.
    """
    if name not in PRESETS:
        raise RleSplatError(f"There is no preset {name!r}; choose one of {', '.join(PRESETS)}.")
    return TransferFunction.from_json(PRESETS[name].path)


def typical_range(volume: Volume) -> tuple[float, float]:
    """(low, high) physical: the 1st and 99.9th percentile of the values.

    Where so many voxels are alike that the two coincide, the whole range; for a constant volume the last unit
    below its value, so that whatever is shown at the upper end shows it.
    """
    low, high = (float(p) for p in percentiles(volume, FIT_PERCENTS))
    if low == high:
        low, high = volume.value_range
    if low == high:
        low = min(low - 1.0, float(np.nextafter(low, -np.inf)))
    return low, high


def fit_preset(name: str, volume: Volume) -> tuple[TransferFunction, str | None]:
    """(the preset in the volume's values, a remark or None where nothing had to be moved).

    A preset in the volume's own unit is taken as it is; the points of any other are moved linearly so that they
    run from the 1st to the 99.9th percentile of the volume's values.
    """
    function = preset(name)
    if function.unit is not None and function.unit == volume.value_unit:
        return function, None
    low, high = typical_range(volume)
    first, last = function.span
    meant = f"in {function.unit}, the volume's values are not" if function.unit else "relative"
    remark = (
        f"The points of the preset {name} are {meant}, so {first:g} to {last:g} was mapped to {low:g} to {high:g}, "
        "the 1st to 99.9th percentile of the values."
    )
    return function.remapped(low, high, unit=volume.value_unit), remark
