"""Values as JSON types."""

import math
from dataclasses import fields, is_dataclass

import numpy as np


def plain(value):
    """Convert a value to JSON types.

    Parameters
    ----------
    value : object
        Any nesting of dict, list, tuple, set, dataclass, numpy and plain types; other types become their ``str``.

    Returns
    -------
    object
        The value, its numbers with all their bits; those that are not finite become None.
    """
    if is_dataclass(value) and not isinstance(value, type):
        return {entry.name: plain(getattr(value, entry.name)) for entry in fields(value)}
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
