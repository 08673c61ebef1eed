"""Writing reports as strict JSON."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np


def plain(value):
    """Convert a value to JSON types.

    Parameters
    ----------
    value : object
        Any nesting of dict, list, tuple, set, numpy and plain types; other types become their ``str``.

    Returns
    -------
    object
        The value; numbers that are not finite become None.
    """
    if isinstance(value, dict):
        return {str(key): plain(entry) for key, entry in value.items()}
    if isinstance(value, (list, tuple, set)):
        return [plain(entry) for entry in value]
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    return str(value)


def write_report(path, report: dict) -> None:
    """Write a report to a file as indented UTF-8 JSON."""
    Path(path).write_text(json.dumps(plain(report), indent=2, allow_nan=False) + "\n", encoding="utf-8")


def number_text(value: float) -> str:
    """A number with at most six significant digits."""
    return f"{value:.6g}"
