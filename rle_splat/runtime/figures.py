"""Figures as people read them: two significant digits, and never an exponent."""

import math

LEAST = 1e-4  # what is smaller is said to be below it


def figure_text(value: float) -> str:
    """A number of zero or more with two significant digits, whole from 10 on: 0.0042, 1.3, 13, 1304."""
    if 0.0 < value < LEAST:
        return f"< {LEAST:.4f}"
    if not math.isfinite(value) or value == 0.0:
        return f"{value:.0f}"
    decimals = max(1 - math.floor(math.log10(float(f"{value:.1e}"))), 0)
    return f"{value:.{decimals}f}"


def percent_text(share: float) -> str:
    """A share from 0 to 1 in percent; neither 0 nor 100 unless it is."""
    percent = 100.0 * share
    if 0.0 < percent < 0.1:
        return "< 0.1%"
    if 99.0 < percent < 100.0:
        return "> 99%"
    return f"{percent:.0f}%" if percent >= 10.0 or percent == 0.0 else f"{percent:.1f}%"
