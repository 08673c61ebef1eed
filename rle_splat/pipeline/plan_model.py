"""The model of a plan's error and time (algorithm.md 2.4); all of its constants are in ``calibration.json``.

``python3 dev.py calibrate`` makes that file from synthetic scenes.  A plan's error is predicted in two ways:

- ``PresetPlan``, for the quality presets: from the roughness of the volume alone, before anything is drawn, so that a
  plan neither waits for pictures nor depends on the camera.
- ``Model``, for tolerances: from small pictures of the scene, the pilots.  In levels, the errors of depth rule and warp
  add in quadrature, as measured.  Each is the pilots' difference times a constant of the rule, or of filter and
  density, an upper envelope over the calibration scenes.  The bounds of termination, short records and rounding are
  added to it.

Neither replaces the other.  On 76 calibration scenes, the errors of three plans of presets were at most 12 to 18 times
what the roughness predicts (99 % of the scenes), and 1.1 to 2.9 times what the pilots predict: a tolerance needs the
pilots.  By the pilots, 10 of 57 pairs of a volume and a preset had different plans in different views.

Time: that of the splat is a sum over rows, runs and pixels of all sheets, that of the warp over pixels.  Both are
scaled by the speed of this machine (``machine.MachineProfile``) to choose a plan; what users see is scaled by the
times of the scene's pilots, or of its latest picture, too (``choose.Speed``).  The presets' plans have single rays by a
threshold, whose number only their picture gives, so their times are measured, over that of ``standard``.
"""

from __future__ import annotations

import json
import zlib
from dataclasses import asdict, dataclass, field
from functools import cache
from pathlib import Path

import numpy as np

from ..classify.roughness import LEVELS
from ..scene import (
    DEFAULT_CLASSIFICATION,
    NO_RAYS,
    PRESET_KNOBS,
    Classification,
    Quality,
    RleSplatError,
    midpoints_of,
    preintegrated_of,
)
from ..splat.scratch import BAND
from ..warp.steep import UNLIMITED

# As panels name rules, with the number in the rule, and the plural.
LAYERS = {"preintegrated": "{} exact layer{}", "midpoint": "{} midpoint{}", "gauss2": "Gauss layers"}
CALIBRATION = Path(__file__).with_name("calibration.json")
LEAST_ROUGHNESS = 0.1  # levels: errors are not extrapolated to smoother media
SHEETS_PER_VOXEL = {"slice": 1, "simpson": 2, "gauss2": 2}
CUBIC = "cubic"
# Bytes of a record -> the relative error of its density, and the error of a color channel as a share of the largest
# color (encode/records.py).
RECORD_ERRORS = {16: (0.0, 0.0), 8: (2.0**-12, 2.0**-12)}
# The same for post, which stores scalars exactly, and normals as codes whose components are 2^-15 off at most: light is
# then 2.3e-4 off at most (two million random normals).  The grid of shadows errs more, which only a measurement tells.
LIGHT_ERRORS = (0.0, 2.0**-12)
FLOAT_ERROR = 2.0**-24  # of each sum and product in the splatter
FLOAT_SHEETS = 1 << 14  # more sheets than this add up in float64
ROUNDINGS = 32  # besides one for each sheet: footprints, the exponential, the warp's taps
ORDER = 2.0  # errors fall with this power of the midpoints or slabs, beyond the calibrated rules


@dataclass(frozen=True)
class PresetPlan:
    """A plan of the quality presets, its cost and its expected error.

    Attributes
    ----------
    knobs : tuple
        Values of PRESET_KNOBS.
    cost : float
        The time of a frame over that of the knobs of ``standard``, the geometric mean over scenes.
    factor, power : float
        The error that 999 of 1000 pixels stay below, in levels, is expected to be ``factor * roughness ** power``.
        Half of the errors on the calibration scenes, whose walls are soft or steps to opaque, were smaller.
    """

    knobs: tuple
    cost: float
    factor: float
    power: float

    def error(self, rough: float) -> float:
        """The expected error in levels, for a roughness in levels."""
        return min(self.factor * max(rough, LEAST_ROUGHNESS) ** self.power, LEVELS)

    @property
    def rays(self) -> float:
        """The threshold of single rays; 0 for none."""
        return self.knobs[-1]

    def report(self) -> dict:
        """As in ``calibration.json``."""
        return {**asdict(self), "knobs": dict(zip(PRESET_KNOBS, self.knobs, strict=True))}

    def describe(self) -> str:
        """In words for a person."""
        rule, density, _, _, rays = self.knobs
        kind, _, count = rule.partition("-")
        text = f"{LAYERS[kind].format(count or 1, 's' * bool(count))}, pixel density {density:g}"
        if rays == NO_RAYS:
            return text
        where = "wherever something is seen" if rays <= UNLIMITED else f"where neighbors differ by {100.0 * rays:.0f}%"
        return f"{text} and exact pixels {where}"


@cache
def preset_plans() -> tuple[PresetPlan, ...]:
    """The plans that presets choose from, as calibrated; the first is that of ``standard``."""
    return tuple(
        PresetPlan(**{**plan, "knobs": tuple(plan["knobs"][knob] for knob in PRESET_KNOBS)})
        for plan in _calibration()["presets"]
    )


@dataclass(frozen=True)
class Features:
    """JSON-ready features of a scene.

    Attributes
    ----------
    depth_step, sheet_step : float
        Levels: the largest difference of the pilots of two depth rules, and of two sheet densities.
    pixels_per_voxel : float
        The size of voxels in the picture.
    sheets : int
        Sheets that a ray meets with the depth rule ``slice``.
    row_sheets, pixel_sheets, sheet_pixels : float
        Of the base planes at a sheet density of one: rows times sheets, pixels times sheets, pixels.
    pixels : int
        Of the picture.
    kept_voxels, runs : int
        Of one axis' tables.
    largest_color : float
        The largest channel of an unassociated color.
    """

    classification: str
    depth_step: float
    sheet_step: float
    pixels_per_voxel: float
    sheets: int
    row_sheets: float
    pixel_sheets: float
    sheet_pixels: float
    pixels: int
    kept_voxels: int
    runs: int
    largest_color: float

    def report(self) -> dict:
        """The features as a dict."""
        return asdict(self)


@dataclass(frozen=True)
class ErrorBudget:
    """The largest expected error in levels, by cause.  ``depth`` and ``warp`` are modeled, the others are bounds."""

    depth: float
    warp: float
    termination: float
    records: float
    rounding: float

    @property
    def modeled(self) -> float:
        """The errors of depth rule and warp together."""
        return float(np.hypot(self.depth, self.warp))

    @property
    def bounds(self) -> float:
        """The sum of the bounds."""
        return self.termination + self.records + self.rounding

    @property
    def total(self) -> float:
        """The sum of all."""
        return self.modeled + self.bounds

    def report(self) -> dict:
        """JSON-ready."""
        return {**asdict(self), "total": self.total}


@dataclass(frozen=True, eq=False)
class Model:
    """The constants of one classification.

    Attributes
    ----------
    depth : dict
        Depth rule -> its error over the features' ``depth_step``.
    warp : dict
        Warp filter -> [[sheet density, error over ``sheet_step``], ...] in the order of the density.
    splat_ms, warp_ms : tuple of float
        Coefficients of ``splat_terms`` and ``warp_terms``.
    family_factor : dict
        Family of depth rules -> the time of its sheets over that of others.
    """

    classification: str
    depth: dict
    warp: dict
    splat_ms: tuple
    warp_ms: tuple
    family_factor: dict = field(default_factory=dict)

    @classmethod
    def of(cls, classification: str) -> Model:
        """The calibrated model of a classification; raises RleSplatError where there is none."""
        entries = _calibration()["classifications"]
        if classification not in entries:
            raise RleSplatError(
                f"Nothing is known of the errors of classification {classification!r}; a tolerance can be asked of "
                f"{' or '.join(entries)}."
            )
        return cls(classification, **entries[classification])

    def errors(self, features: Features, plan: Quality, correction: float = 1.0) -> ErrorBudget:
        """The largest error expected of a plan.

        ``correction``: the factor by which pictures of this scene were found to err more than the model says.
        """
        color = max(features.largest_color, 1.0)
        depth, warp = self.constants(plan)
        density_error, color_error = LIGHT_ERRORS if plan.classification == "post" else RECORD_ERRORS[plan.record]
        sheets = min(features.sheets * family_of(plan.depth_rule)[1], FLOAT_SHEETS)
        return ErrorBudget(
            depth=correction * features.depth_step * depth,
            warp=correction * features.sheet_step * warp,
            termination=LEVELS * plan.termination * color,
            records=LEVELS * color * (2.0 * density_error + color_error),
            rounding=LEVELS * color * FLOAT_ERROR * (sheets + ROUNDINGS),
        )

    def constants(self, plan: Quality) -> tuple[float, float]:
        """The factors of the pilots' differences in depth and in density."""
        return self._depth_constant(plan.depth_rule), self._warp_constant(plan.warp_filter, plan.sheet_density)

    def milliseconds(self, features: Features, plan: Quality) -> tuple[float, float]:
        """Of splat and of warp, on the machine of the calibration."""
        splat = float(np.dot(self.splat_ms, splat_terms(features, plan.depth_rule, plan.sheet_density)))
        splat *= self.family_factor.get(family_of(plan.depth_rule)[0], 1.0)
        return splat, float(np.dot(self.warp_ms, warp_terms(features, plan.warp_filter, plan.sheet_density)))

    def _depth_constant(self, rule: str) -> float:
        if rule in self.depth:
            return self.depth[rule]
        family, m = family_of(rule)
        relatives = {family_of(other)[1]: other for other in self.depth if family_of(other)[0] == family}
        known = max(n for n in relatives if n <= m)
        return self.depth[relatives[known]] * (known / m) ** ORDER

    def _warp_constant(self, warp_filter: str, density: float) -> float:
        at, constants = np.log(np.array(self.warp[warp_filter], dtype=np.float64).T)
        return float(np.exp(np.interp(np.log(max(density, 1e-6)), at, constants)))


def family_of(depth_rule: str) -> tuple[str, int]:
    """The rule's family (``midpoint``, ``preintegrated`` or its own name) and its number of sheets per voxel."""
    for family, count in (("midpoint", midpoints_of(depth_rule)), ("preintegrated", preintegrated_of(depth_rule))):
        if count is not None:
            return family, count
    return depth_rule, SHEETS_PER_VOXEL[depth_rule]


def splat_terms(features: Features, rule: str, density: float) -> np.ndarray:
    """What the milliseconds of a splat are a sum of.

    One; rows that look at a sheet; runs and voxels decoded; sheet pixels resampled along scanlines, and composited;
    pixels of all sheets, looked at or not; pixels of the intermediate images; in millions.  The rows of a band share
    their scanlines; the two at its ends are walked by the next bands, too.
    """
    sheets = family_of(rule)[1]
    rows_per_voxel = density * features.pixels_per_voxel
    walked = 1.0 + 2.0 * rows_per_voxel / BAND  # how often a scanline is walked for a sheet
    return 1e-6 * np.array((
        1e6,
        sheets * density * features.row_sheets,
        sheets * walked * features.runs,
        sheets * walked * features.kept_voxels,
        sheets * walked * rows_per_voxel * features.kept_voxels,
        sheets * rows_per_voxel**2 * features.kept_voxels,
        sheets * density**2 * features.pixel_sheets,
        density**2 * features.sheet_pixels,
    ))  # fmt: skip


def warp_terms(features: Features, warp_filter: str, density: float) -> np.ndarray:
    """What the milliseconds of a warp are a sum of: one; pixels through a filter of two taps, or of four; and sheet
    pixels of which a prefilter makes coefficients; in millions."""
    bilinear = warp_filter == "bilinear"
    return 1e-6 * np.array((
        1e6,
        features.pixels * bilinear,
        features.pixels * (not bilinear),
        density**2 * features.sheet_pixels * (warp_filter == CUBIC),
    ))  # fmt: skip


def calibration_mark() -> str:
    """What tells the calibration at hand from others."""
    return f"{zlib.crc32(CALIBRATION.read_bytes()):08x}"


def default_classification() -> Classification:
    """The classification of a tolerance without a quality: the usual one, or the first that is calibrated."""
    calibrated = _calibration()["classifications"]
    return DEFAULT_CLASSIFICATION if DEFAULT_CLASSIFICATION in calibrated else next(iter(calibrated))


@cache
def _calibration() -> dict:
    return json.loads(CALIBRATION.read_text(encoding="utf-8"))
