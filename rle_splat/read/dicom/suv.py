"""SUV by body weight: the factor from a PET's activity to it, or the reason why there is none.

Weight, dates and times serve this factor alone; no sentence quotes them.
"""

from dataclasses import dataclass
from datetime import date

from . import elements as read

UNIT = "SUVbw"
DAY = 86400.0  # s
LONG_HALF_LIFE = DAY / 2.0  # from here on a scan may be days after the injection, which times of day do not say
MOST_HALF_LIVES = 10.0  # between injection and scan; beyond, a time is wrong


@dataclass(frozen=True)
class Pet:
    """What the header of a PET says of dose and decay; None for what it does not say.

    Attributes
    ----------
    units, decay : str
        ``Units`` and ``DecayCorrection``.
    weight : float or None
        kg
    dose : float or None
        Bq at the injection.
    half_life : float or None
        s
    to_series, to_acquisition : float or None
        Seconds from the injection to the time of the series and of this picture.
    dated : bool
        Whether these were counted with dates, and not by times of day alone.
    """

    units: str
    decay: str
    weight: float | None
    dose: float | None
    half_life: float | None
    to_series: float | None
    to_acquisition: float | None
    dated: bool


def pet_of(dataset) -> Pet:
    """The facts of a file; call it within ``elements.quiet``."""
    drug = read.item(dataset, "RadiopharmaceuticalInformationSequence")
    start = read.text(drug, "RadiopharmaceuticalStartDateTime")
    injected = _moment(start[:8], start[8:].partition("+")[0].partition("-")[0])
    if injected is None:
        injected = _moment("", read.text(drug, "RadiopharmaceuticalStartTime"))
    moments = [
        _moment(read.text(dataset, f"{name}Date"), read.text(dataset, f"{name}Time"))
        for name in ("Series", "Acquisition")
    ]
    return Pet(
        read.text(dataset, "Units"), read.text(dataset, "DecayCorrection"), read.number(dataset, "PatientWeight"),
        read.number(drug, "RadionuclideTotalDose"), read.number(drug, "RadionuclideHalfLife"),
        *(_elapsed(injected, moment) for moment in moments),
        dated=None not in (injected, moments[0]) and None not in (injected[0], moments[0][0]),
    )  # fmt: skip


def _moment(day: str, time: str) -> tuple[int | None, float] | None:
    """(day or None, second of the day); None without a time."""
    seconds = read.seconds(time)
    if seconds is None:
        return None
    try:
        return date(int(day[:4]), int(day[4:6]), int(day[6:])).toordinal(), seconds
    except ValueError:
        return None, seconds


def _elapsed(begin, end) -> float | None:
    """Seconds between two moments; times of day alone are less than a day apart, also over midnight."""
    if begin is None or end is None:
        return None
    if None in (begin[0], end[0]):
        return (end[1] - begin[1]) % DAY
    return (end[0] - begin[0]) * DAY + end[1] - begin[1]


def suv_factor(pets) -> tuple[float, str]:
    """The factor from stored activity to SUV by body weight, and "", or 1 and the reason why there is none.

    SUV = activity in Bq/ml * weight in g / dose in Bq, the dose decayed to the time to which the values are corrected:
    the injection (ADMIN), or the start of the scan (START), which is the time of the series unless this is later than a
    picture, as for a series that was made again. Source: QIBA, vendor-neutral pseudo-code for SUV.

    Parameters
    ----------
    pets : sequence of Pet
        Of all pictures of a volume.
    """
    pet = pets[0]
    reason = next((text for is_so, text in (
        (pet.units != "BQML", "their unit is not Bq/ml"),
        (pet.decay not in ("START", "ADMIN"), "the decay of the activity was not corrected"),
        (not _positive(pet.weight), "the files do not state the weight"),
        (not _positive(pet.dose), "the files do not state the injected dose"),
    ) if is_so), "")  # fmt: skip
    if reason or pet.decay == "ADMIN":
        return (1.0, reason) if reason else (1000.0 * pet.weight / pet.dose, "")
    if not _positive(pet.half_life):
        return 1.0, "the files do not state the half-life"
    if pet.to_series is None:
        return 1.0, "the files do not state the times of injection and scan"
    if not pet.dated and pet.half_life > LONG_HALF_LIFE:
        return 1.0, "the files do not state the days of injection and scan"
    elapsed = min([pet.to_series, *(one.to_acquisition for one in pets if one.to_acquisition is not None)])
    if not 0.0 <= elapsed <= MOST_HALF_LIVES * pet.half_life:
        return 1.0, "the times of injection and scan do not fit each other"
    return 1000.0 * pet.weight / (pet.dose * 0.5 ** (elapsed / pet.half_life)), ""


def _positive(value: float | None) -> bool:
    return value is not None and value > 0.0
