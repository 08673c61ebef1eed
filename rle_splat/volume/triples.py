"""Products of triples of floats, in plain Python: for so few numbers the overhead of a call of numpy is larger."""

import math


def cross(one, two) -> tuple[float, float, float]:
    """Cross product of two triples."""
    (a, b, c), (x, y, z) = one, two
    return b * z - c * y, c * x - a * z, a * y - b * x


def dot(one, two) -> float:
    """Dot product of two triples."""
    (a, b, c), (x, y, z) = one, two
    return a * x + b * y + c * z


def unit(triple) -> list[float]:
    """A triple scaled to length one; zeros are kept."""
    triple = tuple(triple)
    length = math.hypot(*triple) or 1.0
    return [part / length for part in triple]
