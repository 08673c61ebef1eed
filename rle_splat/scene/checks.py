"""Values and JSON files that people give, checked: numbers, matrices, colours, named settings."""

from __future__ import annotations

import json
import math
from dataclasses import fields
from pathlib import Path
from reprlib import repr as short

import numpy as np

from .errors import RleSplatError

# Entries of matrices: cubes of what is larger, as determinants are made of, would leave the range of float64.
LARGEST_ENTRY = 1e100
# Lengths of a camera, in whatever unit, and shares of the picture: far beyond any that is meant.
LEAST_LENGTH, LARGEST_LENGTH = 1e-50, 1e50
LARGEST_SHARE = 1e6


def as_float(value) -> float:
    """A number as float64; infinite when it is too large for one, NaN when it is no number at all."""
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf
    except (TypeError, ValueError):
        return math.nan


def is_finite_number(value) -> bool:
    return isinstance(value, (int, float)) and math.isfinite(as_float(value))


def as_matrix(value, name: str) -> np.ndarray:
    """A finite 4x4 float64 affine matrix from nested lists or an array, or a RleSplatError that names it."""
    try:
        matrix = np.array(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        matrix = np.empty(0)
    if matrix.shape != (4, 4):
        raise RleSplatError(f"{name} must be a 4x4 matrix of numbers, given as four rows of four.")
    if not np.isfinite(matrix).all():
        raise RleSplatError(f"{name} holds a value that is not finite; give sixteen ordinary numbers.")
    if np.abs(matrix).max() > LARGEST_ENTRY:
        raise RleSplatError(f"{name} holds a value beyond {LARGEST_ENTRY:g}; give sixteen ordinary numbers.")
    if any(abs(found - meant) > 1e-8 for found, meant in zip(matrix[3].tolist(), (0.0, 0.0, 0.0, 1.0))):
        raise RleSplatError(f"{name} must be affine: its last row has to be 0 0 0 1.")
    matrix.setflags(write=False)
    return matrix


def identity() -> np.ndarray:
    return as_matrix(np.eye(4), "the identity")


def as_color(value, name: str) -> tuple:
    """A scene-linear RGB colour as three floats, none below zero, or a RleSplatError that names it."""
    color = tuple(as_float(c) for c in value) if np.iterable(value) else ()
    if len(color) != 3 or not np.isfinite(color).all() or min(color) < 0.0:
        raise RleSplatError(f"{name} must be three finite numbers, none below zero.")
    return color


def from_mapping(cls, mapping, what: str):
    """An instance of the frozen dataclass ``cls`` from a JSON object, refusing names it does not have."""
    if not isinstance(mapping, dict):
        raise RleSplatError(f"{what} must be a JSON object with named values.")
    known = {f.name for f in fields(cls)}
    unknown = sorted(set(mapping) - known)
    if unknown:
        raise RleSplatError(f"{what} has no setting called {unknown[0]!r}; it knows {', '.join(sorted(known))}.")
    try:
        return cls(**mapping)
    except TypeError as problem:
        raise RleSplatError(f"{what} is incomplete or of the wrong kind: {problem}.") from None


def read_json(path, what: str):
    """The parsed JSON file at ``path``; a RleSplatError that names the file when it is missing or malformed."""
    try:
        return json.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as problem:
        raise RleSplatError(f"Cannot read {what} {path}: {problem.strerror or problem}; check the path.") from None
    except RecursionError:
        raise RleSplatError(f"{what} {path} is not valid JSON: it is nested without end; mend it there.") from None
    except ValueError as problem:
        raise RleSplatError(f"{what} {path} is not valid JSON: {problem}; mend it there.") from None


def list_of(cls, path, what: str, members: str, member: str) -> tuple:
    """Instances of ``cls`` from the JSON file at ``path``, ``what``, which holds a list of ``members``."""
    entries = read_json(path, what)
    if not isinstance(entries, list):
        raise RleSplatError(f"{what[0].upper()}{what[1:]} {path} must hold a list of {members}.")
    return tuple(from_mapping(cls, entry, f"A {member} of {what}") for entry in entries)


def positive(value, name: str, least: float = LEAST_LENGTH, largest: float = LARGEST_LENGTH) -> float:
    number = as_float(value)
    if not (math.isfinite(number) and number > 0.0):
        raise RleSplatError(f"{name} must be a finite number above zero, not {short(value)}.")
    if not least <= number <= largest:
        raise RleSplatError(f"{name} must be from {least:g} to {largest:g}, not {short(value)}.")
    return number
