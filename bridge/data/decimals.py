"""Conversion of Blender's single-precision properties to the decimals that a user typed."""

import math

import numpy as np


def typed(value) -> float:
    """The shortest decimal that rounds to the same float32, such as 0.1 for the stored 0.10000000149.

    So a picture made from properties equals the one made from the same numbers on the command line.
    """
    return float(str(np.float32(value)))


def typed_tuple(values) -> tuple:
    """``typed`` for each of several values."""
    return tuple(typed(v) for v in values)


def typed_fields(source, names) -> dict:
    """``typed`` for some properties of a datablock, by their names."""
    return {name: typed(getattr(source, name)) for name in names}


def rounded_to_span(values, span: float) -> list[float]:
    """Round values to at most a millionth of their range, the precision of a position stored in single precision.

    A span that is not above zero leaves the values unchanged.
    """
    if not span > 0.0:
        return list(values)
    digits = 6 - math.floor(math.log10(span))
    return [round(value, digits) for value in values]
