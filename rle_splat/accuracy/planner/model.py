"""The model of a plan's error and time (algorithm.md 2.4), with constants from ``calibration.json``.

``python3 dev.py calibrate`` makes that file anew, from scenes of formulas.

Error, in levels: what depth rule and warp err adds in quadrature, as it was measured to, and is the pilots' difference
times a constant of the rule, or of filter and density, an upper envelope over the calibration scenes.  On top come
bounds that always hold: of termination, of short records, and of rounding.

Time: of the splat in proportion to rows, runs and pixels of all sheets, of the warp to pixels; and a factor for this
machine and these tables, from what the pilots or other frames of the scene took.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from functools import cache
from pathlib import Path

import numpy as np

from ...scene import DEFAULT_CLASSIFICATION, Quality, RleSplatError
from .candidates import family_of
from .features import LEVELS, Features

CALIBRATION = Path(__file__).with_name("calibration.json")
CUBIC = "cubic"
# Of a record of so many bytes: relative error of its density, and error of a colour's channel as a share of the largest
# colour (encode/records.py).
RECORD_ERRORS = {16: (0.0, 0.0), 8: (2.0**-12, 2.0**-12), 6: (2.0**-12, 0.5 / 1023), 4: (0.0024, 0.5 / 127)}
LIGHT_ERRORS = (0.0, 2.0**-12)  # the same of post, which keeps scalars as they are, and light as 16-bit floats
FLOAT_ERROR = 2.0**-24  # of each sum and product in the splatter; more sheets than these add up in float64
FLOAT_SHEETS = 1 << 14
ROUNDINGS = 32  # of those, beside one for each sheet: footprints, the exponential, the warp's taps
ORDER = 2.0  # of midpoints and of slabs: what errors fall with, beyond the rules that were calibrated


@dataclass(frozen=True)
class ErrorBudget:
    """Levels, by cause; ``depth`` and ``warp`` are modelled, the others are bounds."""

    depth: float
    warp: float
    termination: float
    records: float
    rounding: float

    @property
    def modelled(self) -> float:
        return float(np.hypot(self.depth, self.warp))

    @property
    def bounds(self) -> float:
        return self.termination + self.records + self.rounding

    @property
    def total(self) -> float:
        return self.modelled + self.bounds

    def report(self) -> dict:
        return {**asdict(self), "total": self.total}


@dataclass(frozen=True, eq=False)
class Model:
    """One classification's constants.

    ``depth``: rule -> its error over the features' ``depth_step``.  ``warp``: filter -> [[sheet density, error over
    ``sheet_step``], ...], densities rising.  ``splat_ms`` and ``warp_ms``: coefficients of ``splat_terms`` and
    ``warp_terms``.  ``family_factor``: family of depth rules -> what its sheets take over what those of others take.
    """

    classification: str
    depth: dict
    warp: dict
    splat_ms: tuple
    warp_ms: tuple
    family_factor: dict = field(default_factory=dict)

    @classmethod
    def of(cls, classification: str) -> Model:
        """The shipped one."""
        entries = _calibration()
        if classification not in entries:
            why = f"Nothing is known of the errors of classification {classification!r}"
            if classification == "refined":  # whose grid is as fine as it is, whatever the sheets
                why = "The grid on which refined classifies errs by itself, and no plan takes that away"
            raise RleSplatError(f"{why}; a tolerance can be asked of {' or '.join(entries)}.")
        return cls(classification, **entries[classification])

    def errors(self, features: Features, plan: Quality, correction: float = 1.0) -> ErrorBudget:
        """What the plan is expected to err at most.  ``correction``: how many times more than the model says the scene
        has been found to err."""
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
        """What the pilots' differences in depth and in density are multiplied by."""
        return self._depth_constant(plan.depth_rule), self._warp_constant(plan.warp_filter, plan.sheet_density)

    def milliseconds(self, features: Features, plan: Quality) -> tuple[float, float]:
        """Of splat and of warp, on the machine that the file was made on."""
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


def splat_terms(features: Features, rule: str, density: float) -> np.ndarray:
    """What the milliseconds of a splat are a sum of: one; rows that look at a sheet; runs and voxels that they decode;
    sheet pixels composited; pixels of all sheets, looked at or not; pixels of the intermediate images; in millions."""
    sheets = family_of(rule)[1]
    rows_per_voxel = density * features.pixels_per_voxel
    return 1e-6 * np.array((
        1e6,
        sheets * density * features.row_sheets,
        sheets * rows_per_voxel * features.runs,
        sheets * rows_per_voxel * features.kept_voxels,
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


def default_classification() -> str:
    """The classification that a tolerance is asked of by itself: the usual one, or the first that is calibrated."""
    calibrated = _calibration()
    return DEFAULT_CLASSIFICATION if DEFAULT_CLASSIFICATION in calibrated else next(iter(calibrated))


@cache
def _calibration() -> dict:
    return json.loads(CALIBRATION.read_text(encoding="utf-8"))["classifications"]
