"""The light of a world that is not the same from all directions."""

from dataclasses import dataclass

import numpy as np

from .errors import RleSplatError

SHAPES = {"first": (3, 3), "second": (3, 3, 3)}


@dataclass(frozen=True, eq=False)
class Environment:
    """How a world's radiance differs by direction: its spherical harmonics of orders 1 and 2, as moments.

    The nine harmonics up to order 2 hold the irradiance of a surface to about 1 % of its largest (Ramamoorthi and
    Hanrahan, *An Efficient Representation for Irradiance Environment Maps*, 2001). That of order 0 is the mean, which
    is ``Scene.world``. Moments hold the same numbers and need no table of normalizations.

    Parameters
    ----------
    first : (3, 3) array_like
        Mean over all directions of radiance times direction: world axis, then scene-linear RGB.
    second : (3, 3, 3) array_like
        Mean of radiance times the product of two components of the direction, less a third of the mean radiance on the
        diagonal: two world axes, then RGB. Symmetric, with a trace of 0.

    Raises
    ------
    RleSplatError
        For another shape, or a number that is not finite.
    """

    first: np.ndarray
    second: np.ndarray

    def __post_init__(self):
        for name, shape in SHAPES.items():
            value = np.array(getattr(self, name), np.float64)
            if value.shape != shape or not np.isfinite(value).all():
                raise RleSplatError(
                    f"An environment's {name} moment must be finite numbers of shape {shape}, not {value.shape}."
                )
            value.flags.writeable = False
            object.__setattr__(self, name, value)
