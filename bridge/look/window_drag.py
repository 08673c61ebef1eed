"""Window and level by dragging the mouse, as plain numbers: to the right the window grows, upward the level rises."""

import math
from dataclasses import dataclass

REACH = 400.0  # pixels at interface scale 1 by which a drag doubles the window
NARROWEST, WIDEST = 1.0 / 64.0, 2.0  # of the range of values: bounds of the window that decides the speed
FINE = 0.1  # speed with Shift


@dataclass
class WindowDrag:
    """A drag that has begun.

    Parameters
    ----------
    center, width : float
        Level and window as the drag begins, physical values.
    low, high : float
        Smallest and largest value of the volume.
    scale : float
        Interface scale: a screen with small pixels has more of them.
    """

    center: float
    width: float
    low: float
    high: float
    scale: float = 1.0

    def __post_init__(self):
        span = self.high - self.low
        of_speed = min(max(self.width, NARROWEST * span), WIDEST * span) if span > 0.0 else self.width
        self.rate = of_speed / (REACH * self.scale)  # value for each pixel
        self._grain = 10.0 ** math.floor(math.log10(self.rate))  # values stay multiples of it
        self._right = self._up = 0.0

    def move(self, right: float, up: float, is_fine: bool = False) -> tuple[float, float]:
        """Drag further.

        Parameters
        ----------
        right, up : float
            Pixels since the last call.
        is_fine : bool
            Whether these pixels count a tenth.

        Returns
        -------
        center, width : float
            The new level and window, moved from where they began by multiples of a power of ten.
        """
        rate = self.rate * (FINE if is_fine else 1.0)
        self._right += right * rate
        self._up += up * rate
        # Back from beyond the narrowest window, the first pixel counts.
        self._right = max(self._right, min(self._grain - self.width, 0.0))
        grain = self._grain * (FINE if is_fine else 1.0)
        center, width = (start + round(by / grain) * grain for start, by in
                         ((self.center, self._up), (self.width, self._right)))  # fmt: skip
        return center, max(width, min(self._grain, self.width))
