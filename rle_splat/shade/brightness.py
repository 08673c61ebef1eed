"""How bright lights make a volume before it is rendered, compared with a headlight."""

from __future__ import annotations

import numpy as np

from .lighting import BACK, Lighting, unit_vectors
from .lights import NEAREST, RGB
from .reference import find_light

OF_SPHERE = 2.0 / 3.0  # mean radiance of a white Lambert sphere whose light comes from the eye


def relative_brightness(falling: Lighting, point) -> float:
    """The diffuse light, without shadows, on a white sphere as the eye sees it; 1 is that of one headlight.

    A Lambert sphere whose light and eye are apart by the angle a has (sin a + (pi - a) cos a) / pi of the brightness
    that it has for a = 0 (its phase function).  Two-sided surfaces are lit from behind, too, which adds the same of
    pi - a.  A sphere under a sky of uniform radiance W has the mean radiance W.

    Parameters
    ----------
    falling : Lighting
        Of the lights; ambient light that belongs to the material does not count.
    point : (3,) array_like
        The sphere's middle in the world; its radius does not matter.
    """
    points = np.asarray(point, np.float64)[None]
    eye = unit_vectors(falling.eye[:3] - falling.eye[3] * points)[0]
    sky = (falling.material[4:7] - falling.material[0]) / max(falling.material[1], 1e-6)
    found = float(sky.mean()) / OF_SPHERE
    for light in falling.rows:
        towards, falloff = find_light(light, points)
        angle = float(np.arccos(np.clip(towards[0] @ eye, -1.0, 1.0)))
        seen = _phase(angle) + falling.material[BACK] * _phase(np.pi - angle)
        found += seen * float(falloff[0]) * float(light[RGB:NEAREST].mean())
    return found


def _phase(angle: float) -> float:
    return float((np.sin(angle) + (np.pi - angle) * np.cos(angle)) / np.pi)
