"""Checks of user input: numbers, matrices, colors, JSON files."""

import json
import math
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from reprlib import repr as short
from typing import Literal

import numpy as np

from .errors import RleSplatError

# Largest matrix entry: a determinant multiplies three entries, and the cube of a larger one would overflow float64.
LARGEST_ENTRY = 1e100
# Range of camera lengths, in any unit, and of shares of the picture; far beyond any sensible setting.
LEAST_LENGTH, LARGEST_LENGTH = 1e-50, 1e50
LARGEST_SHARE = 1e6
# Name -> scene-linear RGB; None is transparent.
BACKGROUNDS = {"white": (1.0, 1.0, 1.0), "black": (0.0, 0.0, 0.0), "transparent": None}
Background = Literal["white", "black", "transparent"] | Sequence[float]


def check_first(value, kind: type, call: str) -> None:
    """Raise RleSplatError if the first argument of a function, as of ``call``, is of another type."""
    if not isinstance(value, kind):
        raise RleSplatError(f"{call} takes a {kind.__name__} first, not {short(value)}.")


def refuse_array(volume) -> None:
    """Raise RleSplatError if an array is given where a Volume is needed."""
    if isinstance(volume, np.ndarray):
        raise RleSplatError("The volume is an array; make a Volume of it, as in Volume(array, affine).")


def as_float(value) -> float:
    """Convert to float64; infinity for a number too large for float64, NaN for anything that is not a number."""
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf
    except (TypeError, ValueError):
        return math.nan


def is_finite_number(value) -> bool:
    """Whether ``value`` is an int or a float with a finite value."""
    return isinstance(value, (int, float)) and math.isfinite(as_float(value))


def as_matrix(value, name: str) -> np.ndarray:
    """Check an affine matrix.

    Parameters
    ----------
    value : (4, 4) array_like
    name : str
        Name of the matrix, used in error messages.

    Returns
    -------
    (4, 4) ndarray of float64
        Read-only copy.

    Raises
    ------
    RleSplatError
        If the shape is wrong, an entry is not finite or too large, or the last row is not 0 0 0 1.
    """
    try:
        matrix = np.array(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        matrix = np.empty(0)
    if matrix.shape != (4, 4):
        raise RleSplatError(f"{name} must be a 4x4 matrix of numbers; give four rows of four.")
    if not np.isfinite(matrix).all():
        raise RleSplatError(f"{name} holds a value that is not finite; give sixteen finite numbers.")
    if np.abs(matrix).max() > LARGEST_ENTRY:
        raise RleSplatError(f"{name} holds a value beyond {LARGEST_ENTRY:g}; give sixteen smaller numbers.")
    if any(abs(found - meant) > 1e-8 for found, meant in zip(matrix[3].tolist(), (0.0, 0.0, 0.0, 1.0))):
        raise RleSplatError(f"{name} must be affine; its last row must be 0 0 0 1.")
    matrix.setflags(write=False)
    return matrix


def identity() -> np.ndarray:
    """Read-only (4, 4) float64 identity matrix."""
    return as_matrix(np.eye(4), "the identity")


def as_color(value, name: str) -> tuple:
    """Check a scene-linear RGB color; return three floats >= 0. ``name`` is used in the error message."""
    color = tuple(as_float(c) for c in value) if np.iterable(value) else ()
    if len(color) != 3 or not np.isfinite(color).all() or min(color) < 0.0:
        raise RleSplatError(f"{name} must be three finite numbers, none below zero.")
    return color


def as_background(value, name: str = "The background") -> tuple | None:
    """Scene-linear RGB of one of BACKGROUNDS or of a color; None is transparent. ``name`` is for the error message."""
    if isinstance(value, str) and value in BACKGROUNDS:
        return BACKGROUNDS[value]
    try:
        return as_color(None if isinstance(value, str) else value, name)
    except RleSplatError:
        names = ", ".join(BACKGROUNDS)
        raise RleSplatError(
            f"{name} must be {names} or three finite numbers, none below zero, not {short(value)}."
        ) from None


def from_mapping(cls, mapping, what: str):
    """Make an instance of the dataclass ``cls`` from a JSON object; unknown keys raise a RleSplatError."""
    if not isinstance(mapping, dict):
        raise RleSplatError(f"{what} must be a JSON object with named values.")
    known = {f.name for f in fields(cls)}
    unknown = sorted(set(mapping) - known)
    if unknown:
        raise RleSplatError(f"{what} has no setting called {unknown[0]!r}; it has {', '.join(sorted(known))}.")
    try:
        return cls(**mapping)
    except TypeError as problem:
        raise RleSplatError(f"{what} is incomplete or has a value of the wrong type: {problem}.") from None


def read_json(path, what: str):
    """Parse the JSON file ``path``. A missing or malformed file raises a RleSplatError that names it as ``what``."""
    try:
        return json.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as problem:
        raise RleSplatError(f"Cannot read {what} {path}: {problem.strerror or problem}; check the path.") from None
    except RecursionError:
        raise RleSplatError(f"{what} {path} is not valid JSON: it is nested too deeply; correct the file.") from None
    except ValueError as problem:
        raise RleSplatError(f"{what} {path} is not valid JSON: {problem}; correct the file.") from None


def list_of(cls, path, what: str, members: str, member: str) -> tuple:
    """Read a tuple of ``cls`` from the JSON file ``path``, which must hold a list.

    ``what`` names the file in messages, ``members`` and ``member`` its entries in plural and singular.
    """
    entries = read_json(path, what)
    if not isinstance(entries, list):
        raise RleSplatError(f"{what[0].upper()}{what[1:]} {path} must hold a list of {members}.")
    return tuple(from_mapping(cls, entry, f"A {member} of {what}") for entry in entries)


def positive(value, name: str, least: float = LEAST_LENGTH, largest: float = LARGEST_LENGTH) -> float:
    """Check that a number lies in [``least``, ``largest``]; return it as float."""
    number = as_float(value)
    if not (math.isfinite(number) and number > 0.0):
        raise RleSplatError(f"{name} must be a finite number above zero, not {short(value)}.")
    if not least <= number <= largest:
        raise RleSplatError(f"{name} must be from {least:g} to {largest:g}, not {short(value)}.")
    return number
