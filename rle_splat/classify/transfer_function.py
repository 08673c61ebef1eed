"""The transfer function: scalar value -> opacity and color, and how the color is shaded.

Points are physical values. Both curves are linear between points and constant outside them. A repeated value is a
step; at the value itself the last of the repeated points counts (right-continuous). Infinite values take the end
values. NaN is transparent, because it marks missing data.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from functools import cached_property, partial
from pathlib import Path
from reprlib import repr as short

import numpy as np
from numpy.typing import ArrayLike

from ..scene import RleSplatError, as_float, from_mapping, read_json
from ..volume.volume import LARGEST_VALUE
from .limits import BRIGHTEST, MOST_REFLECTED


def _number(value, what: str) -> float:
    """Check a JSON number; return it as a finite float. ``what`` names it in messages."""
    number = math.nan if isinstance(value, (bool, str)) else as_float(value)
    if math.isnan(number) and not isinstance(value, float):
        raise RleSplatError(f"{what} must be a number, not {short(value)}.")
    if not math.isfinite(number):
        raise RleSplatError(f"{what} must be finite, not {number}.")
    if abs(number) > LARGEST_VALUE:
        raise RleSplatError(f"{what} must be within {LARGEST_VALUE:g} of zero, not {number:g}.")
    return number


SMOOTHEST = 100.0  # mm


RAMP = ((0.0, 0.0), (1.0, 1.0))  # of a gradient opacity


@dataclass(frozen=True)
class Shade:
    """Shading coefficients: c * (ambient + diffuse |n.l|) + specular |n.h|^shininess, for a color c.

    Parameters
    ----------
    ambient, diffuse, specular, shininess : float
        None below zero.
    two_sided : bool
        If False, only the side toward falling values is lit: there is no light where n.l is below zero.
    smoothness : float or None
        Standard deviation, in mm, of the Gaussian that the values are smoothed with before normals are taken of them;
        ``post`` only. None for the largest voxel spacing, at most 2 mm; 0 for no smoothing.

    Raises
    ------
    RleSplatError
        If a value is out of range.
    """

    ambient: float = 0.25
    diffuse: float = 0.75
    specular: float = 0.2
    shininess: float = 20.0
    two_sided: bool = True
    smoothness: float | None = None

    def __post_init__(self):
        if not isinstance(self.two_sided, bool):
            raise RleSplatError(f"The shading's two_sided must be true or false, not {short(self.two_sided)}.")
        if self.smoothness is not None:
            smoothness = _number(self.smoothness, "The shading's smoothness")
            if not 0.0 <= smoothness <= SMOOTHEST:
                raise RleSplatError(
                    f"The shading's smoothness must be from 0 to {SMOOTHEST:g} mm, not {smoothness:g}; leave it out "
                    "for an automatic one."
                )
            object.__setattr__(self, "smoothness", smoothness)
        for entry in fields(self)[:4]:
            value = _number(getattr(self, entry.name), f"The shading's {entry.name}")
            if value < 0.0:
                raise RleSplatError(f"The shading's {entry.name} must not be below zero, not {value:g}.")
            if value > MOST_REFLECTED and entry.name != "shininess":
                raise RleSplatError(f"The shading's {entry.name} must not be above {MOST_REFLECTED:g}, not {value:g}.")
            object.__setattr__(self, entry.name, value)

    def to_json(self) -> dict:
        """JSON object; ``smoothness`` only if it is set."""
        mapping = asdict(self)
        if self.smoothness is None:
            del mapping["smoothness"]
        return mapping


# Phong's highlight is (r.v)^n, with the light's mirrored direction r and the direction v to the eye.  The direction h
# half-way between light and eye is half as far from the normal as r is from v, and near the highlight's middle cos(a)^n
# and cos(a / 2)^(4 n) are both nearly exp(-n a^2 / 2): F. Fisher and A. Woo, R.E versus N.H specular highlights,
# Graphics Gems IV, 1994.
BLINN_PER_PHONG = 4.0


def blinn_shininess(phong: float) -> float:
    """The shininess of Shade whose highlight is nearly Phong's, of files of 3D Slicer and of earlier versions."""
    return min(BLINN_PER_PHONG * phong, LARGEST_VALUE)


def _read_shade(mapping) -> Shade:
    """The Shade of a JSON object; earlier versions wrote a ``highlight``, "phong" or "blinn-phong", too."""
    if isinstance(mapping, dict) and mapping.get("highlight") in ("phong", "blinn-phong"):
        mapping = dict(mapping)
        if mapping.pop("highlight") == "phong":
            shininess = _number(mapping.get("shininess", Shade.shininess), "The shading's shininess")
            mapping["shininess"] = blinn_shininess(shininess)
    return from_mapping(Shade, mapping, "The transfer function's shade")


@dataclass(frozen=True)
class GradientOpacity:
    """Opacity by gradient magnitude: the extinction is multiplied by a curve.

    Parameters
    ----------
    low, high : float
        Gradients between which the curve lies; beyond them its ends go on. Physical values per unit of the volume's
        length, such as HU per mm. Equal ends are a step.
    curve : sequence of (share, factor)
        Points, joined by straight lines: shares of the way from ``low`` to ``high``, and the factor there, both in
        [0, 1]. By default a ramp from 0 to 1.

    Raises
    ------
    RleSplatError
        If ``low`` is negative or above ``high``, or a point is not a number or outside [0, 1].
    """

    low: float = 0.0
    high: float = 1.0
    curve: Sequence[Sequence[float]] = RAMP

    def __post_init__(self):
        for name in ("low", "high"):
            object.__setattr__(self, name, _number(getattr(self, name), f"The gradient opacity's {name}"))
        if not 0.0 <= self.low <= self.high:
            raise RleSplatError(
                f"The gradient opacity's low must be from 0 to its high ({self.high:g}), not {self.low:g}."
            )
        curve = _points(self.curve, 2, "gradient opacity", "[share, factor]")
        if not all(0.0 <= number <= 1.0 for point in curve for number in point):
            raise RleSplatError("Shares and factors of the gradient opacity's curve must be from 0 to 1.")
        object.__setattr__(self, "curve", curve)

    def factor(self, sizes: ArrayLike) -> np.ndarray:
        """Factors of the extinction, float32 in [0, 1], for gradient magnitudes ``sizes`` of any shape."""
        sizes = np.asarray(sizes, np.float64)
        if self.low == self.high:
            share = (sizes >= self.low).astype(np.float64)
        else:
            share = np.clip((sizes - self.low) / (self.high - self.low), 0.0, 1.0)
        if self.curve != RAMP:
            points = np.array(self.curve)
            share = _piecewise_linear(points[:, 0], points[:, 1], share)
        return share.astype(np.float32)

    def to_json(self) -> dict:
        """JSON object; ``curve`` only if it is no ramp."""
        mapping = {"low": self.low, "high": self.high}
        return mapping if self.curve == RAMP else mapping | {"curve": [list(point) for point in self.curve]}


def _points(points, width: int, what: str, form: str) -> tuple:
    """Check points; return tuples of floats, sorted by value. Equal values keep their order."""
    try:
        rows = [tuple(point) for point in points]
    except TypeError:
        raise RleSplatError(f"The transfer function's {what} must be a list of {form} points.") from None
    if not rows:
        raise RleSplatError(f"The transfer function has no {what} points; give at least one {form}.")
    if any(len(row) != width for row in rows):
        raise RleSplatError(f"Each {what} point of the transfer function must be {form}.")
    rows = [tuple(_number(v, f"Each number of the transfer function's {what} points") for v in row) for row in rows]
    return tuple(sorted(rows, key=lambda row: row[0]))


def _piecewise_linear(positions: np.ndarray, heights: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Right-continuous piecewise linear interpolation with constant ends; NaN stays NaN.

    ``positions`` (n,) ascending, ``heights`` (n, ...), ``values`` any shape; returns values.shape + heights.shape[1:].
    """
    passed = np.searchsorted(positions, values, side="right")  # number of points at or left of the value
    left = np.clip(passed - 1, 0, positions.size - 1)
    right = np.clip(passed, 0, positions.size - 1)
    between = (passed > 0) & (passed < positions.size)  # here positions[right] > positions[left]: no 0/0 at steps
    fraction = np.zeros(values.shape)
    np.divide(values - positions[left], positions[right] - positions[left], out=fraction, where=between)
    fraction = fraction.reshape(values.shape + (1,) * (heights.ndim - 1))
    result = heights[left] + (heights[right] - heights[left]) * fraction
    result[np.isnan(values)] = np.nan
    return result


@dataclass(frozen=True)
class TransferFunction:
    """A transfer function. Objects with equal contents compare equal.

    Parameters
    ----------
    name : str
        For captions and reports.
    unit : str or None
        Unit of the values ("HU"); None for arbitrary units.
    opacity : sequence of (value, alpha)
        Alpha in [0, 1] per ``opacity_unit_distance``. Points are sorted by value; equal values keep their order.
    color : sequence of (value, r, g, b)
        Scene-linear, unassociated, none below zero. Sorted like ``opacity``.
    opacity_unit_distance : float or None
        In the volume's unit of length; None for the smallest voxel spacing.
    shade : Shade or None
        None for unshaded colors.
    gradient_opacity : GradientOpacity or None
        None for opacity by value alone.

    Raises
    ------
    RleSplatError
        If a value is of the wrong type or out of range.
    """

    name: str = ""
    unit: str | None = None
    opacity: Sequence[Sequence[float]] = ()
    color: Sequence[Sequence[float]] = ()
    opacity_unit_distance: float | None = None
    shade: Shade | None = field(default_factory=Shade)
    gradient_opacity: GradientOpacity | None = None

    def __post_init__(self):
        put = partial(object.__setattr__, self)
        if not isinstance(self.name, str):
            raise RleSplatError(f"The transfer function's name must be text, not {short(self.name)}.")
        if not (self.unit is None or (isinstance(self.unit, str) and self.unit)):
            raise RleSplatError('The transfer function\'s unit must be text such as "HU", or None.')
        put("opacity", _points(self.opacity, 2, "opacity", "[value, alpha]"))
        put("color", _points(self.color, 4, "color", "[value, r, g, b]"))
        for value, alpha in self.opacity:
            if not 0.0 <= alpha <= 1.0:
                raise RleSplatError(
                    f"The opacity at {value:g} is {alpha:g}; an opacity of the transfer function must be from 0 to 1."
                )
        for value, *rgb in self.color:
            if min(rgb) < 0.0:
                raise RleSplatError(f"The color at {value:g} has a negative channel; channels must not be below zero.")
            if max(rgb) > BRIGHTEST:
                raise RleSplatError(
                    f"The color at {value:g} has a channel above {BRIGHTEST:g}, where white is 1; make it darker."
                )
        if self.opacity_unit_distance is not None:
            distance = _number(self.opacity_unit_distance, "The transfer function's opacity_unit_distance")
            if distance <= 0.0:
                raise RleSplatError(
                    f"The transfer function's opacity_unit_distance must be above zero, not {distance:g}."
                )
            put("opacity_unit_distance", distance)
        if not (self.shade is None or isinstance(self.shade, Shade)):
            raise RleSplatError("The transfer function's shade must be a Shade, or None for unshaded colors.")
        if not (self.gradient_opacity is None or isinstance(self.gradient_opacity, GradientOpacity)):
            raise RleSplatError("The transfer function's gradient_opacity must be a GradientOpacity, or None.")

    # --- evaluation -------------------------------------------------------------------------------------------

    def alpha_at(self, values: ArrayLike) -> np.ndarray:
        """Opacity in [0, 1] at physical ``values`` (any shape), float64, same shape; 0 at NaN."""
        values = np.asarray(values, dtype=np.float64)
        points = np.array(self.opacity)
        alpha = np.clip(_piecewise_linear(points[:, 0], points[:, 1], np.atleast_1d(values)), 0.0, 1.0)
        return np.where(np.isnan(alpha), 0.0, alpha).reshape(values.shape)

    def color_at(self, values: ArrayLike) -> np.ndarray:
        """Unassociated scene-linear RGB at physical ``values``, float64, shape values.shape + (3,); 0 at NaN."""
        values = np.asarray(values, dtype=np.float64)
        points = np.array(self.color)
        color = _piecewise_linear(points[:, 0], points[:, 1:], np.atleast_1d(values))
        return np.where(np.isnan(color), 0.0, color).reshape(values.shape + (3,))

    def table(self, values: ArrayLike) -> np.ndarray:
        """(..., 4) float64: unassociated r, g, b and alpha at physical ``values``."""
        return np.concatenate((self.color_at(values), self.alpha_at(values)[..., None]), axis=-1)

    # --- moving the points ------------------------------------------------------------------------------------

    @property
    def span(self) -> tuple[float, float]:
        """Lowest and highest value of any point."""
        return min(self.opacity[0][0], self.color[0][0]), max(self.opacity[-1][0], self.color[-1][0])

    def remapped(self, low: float, high: float, unit: str | None = None) -> TransferFunction:
        """Copy with the points moved linearly.

        Parameters
        ----------
        low, high : float
            New ``span``. Equal values gather all points at one value: a step from the first height to the last.
        unit : str or None
            Unit of the new values.
        """
        low, high = _number(low, "The low end of the new range"), _number(high, "The high end of the new range")
        if low > high:
            raise RleSplatError(f"The new range runs from {low:g} to {high:g}; give the lower end first.")
        first, last = self.span
        length = last - first

        def move(value):
            t = (value - first) / length if length > 0.0 else 0.0
            return low * (1.0 - t) + high * t

        return replace(
            self,
            unit=unit,
            opacity=tuple((move(v), a) for v, a in self.opacity),
            color=tuple((move(v), *rgb) for v, *rgb in self.color),
            gradient_opacity=self._steeper((high - low) / length if length > 0.0 else 1.0),
        )

    def _steeper(self, times: float) -> GradientOpacity | None:
        """The gradient opacity for values that are ``times`` as large."""
        ends = self.gradient_opacity
        return ends if ends is None else replace(ends, low=ends.low * times, high=ends.high * times)

    def windowed(self, center: float, width: float) -> TransferFunction:
        """Copy with the points spread over a radiological window with level ``center`` and width ``width``."""
        center, width = _number(center, "The window's center"), _number(width, "The window's width")
        if width < 0.0:
            raise RleSplatError("The window's width must not be below zero.")
        return self.remapped(center - 0.5 * width, center + 0.5 * width, unit=self.unit)

    # --- identity and files -----------------------------------------------------------------------------------

    @cached_property
    def classification_key(self) -> str:
        """Hash of everything on which opacity and color depend; name and shade are not included."""
        steep = () if self.gradient_opacity is None else (self.gradient_opacity.to_json(),)
        return _digest((self.opacity, self.color, self.opacity_unit_distance, *steep))

    @cached_property
    def key(self) -> str:
        """Hash of everything on which a picture depends; the name is not included."""
        return _digest((self.classification_key, None if self.shade is None else self.shade.to_json()))

    @classmethod
    def from_json(cls, source: str | os.PathLike | dict) -> TransferFunction:
        """Make a TransferFunction from JSON.

        Parameters
        ----------
        source : str, Path or dict
            A JSON file, or its parsed content.

        Raises
        ------
        RleSplatError
            If the file cannot be read, or a key is missing or unknown.
        """
        mapping = read_json(source, "the transfer function") if isinstance(source, (str, os.PathLike)) else source
        if not isinstance(mapping, dict):
            raise RleSplatError("A transfer function must be a JSON object with opacity and color points.")
        for name in ("opacity", "color"):
            if name not in mapping:
                raise RleSplatError(f"The transfer function has no {name} points; give {name!r} as a list of points.")
        mapping = dict(mapping)
        shade = mapping.get("shade", {})
        if shade is False or shade is None:
            mapping["shade"] = None
        else:
            mapping["shade"] = _read_shade(shade)
        if mapping.get("gradient_opacity") is not None:
            what = "The transfer function's gradient_opacity"
            mapping["gradient_opacity"] = from_mapping(GradientOpacity, mapping["gradient_opacity"], what)
        return from_mapping(cls, mapping, "The transfer function")

    def to_json(self) -> dict:
        """JSON object: name, unit, opacity, color, opacity_unit_distance (if set), shade or false, gradient_opacity."""
        mapping = {
            "name": self.name,
            "unit": self.unit,
            "opacity": [list(point) for point in self.opacity],
            "color": [list(point) for point in self.color],
        }
        if self.opacity_unit_distance is not None:
            mapping["opacity_unit_distance"] = self.opacity_unit_distance
        mapping["shade"] = False if self.shade is None else self.shade.to_json()
        if self.gradient_opacity is not None:
            mapping["gradient_opacity"] = self.gradient_opacity.to_json()
        return mapping

    def save(self, path: str | os.PathLike) -> None:
        """Write the JSON file ``path``."""
        try:
            Path(path).write_text(json.dumps(self.to_json(), indent=2) + "\n", encoding="utf-8")
        except OSError as problem:
            raise RleSplatError(
                f"Cannot write the transfer function {path}: {problem.strerror}; choose another location."
            ) from None


def _digest(content) -> str:
    """Hash of the ``repr`` of ``content``."""
    return hashlib.blake2b(repr(content).encode(), digest_size=16).hexdigest()
