"""Blender keeps float properties in single precision; people type decimals.  One function between the two."""

import math

import numpy as np


def typed(value) -> float:
    """The shortest decimal that rounds to the same float32: 0.1 for the stored 0.10000000149, float64.

    With it a picture made from properties equals the one made from the same numbers on the command line.
    """
    return float(str(np.float32(value)))


def typed_tuple(values) -> tuple:
    return tuple(typed(v) for v in values)


def rounded_to_span(value: float, span: float) -> float:
    """``value`` to a millionth of ``span`` or finer: what a position stored in single precision can tell."""
    if not span > 0.0:
        return value
    return round(value, 6 - math.floor(math.log10(span)))
