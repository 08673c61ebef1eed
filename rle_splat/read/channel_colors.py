"""Colors of the channels of one file, such as fluorescent dyes: those of its metadata, or a convention's."""

import re

from ..scene.color import linear

# Green and magenta, which color-blind people distinguish too, and cyan; then the other primaries.
CONVENTION = ((0, 1, 0), (1, 0, 1), (0, 1, 1), (1, 1, 0), (1, 0, 0), (0, 0, 1))  # sRGB
# Upper end of a band of emission in nm, and its color.
BANDS = ((490, (0, 0, 1)), (510, (0, 1, 1)), (570, (0, 1, 0)), (590, (1, 1, 0)), (620, (1, 0.5, 0)), (700, (1, 0, 0)))
FAR_RED = (1, 0, 1)
OME_CHANNEL = re.compile(r"<(?:\w+:)?Channel\b[^>]*>")
OME_COLOR = re.compile(r'\bColor="(-?\d{1,10})"')
OME_EMISSION = re.compile(r'\bEmissionWavelength="(\d{1,4}(?:\.\d*)?)"')


def color_of(number: int, count: int, stated=()) -> tuple | None:
    """The color of one channel.

    Parameters
    ----------
    number : int
        From 0.
    count : int
        How many channels there are; one alone has no color.
    stated : sequence of (3,) tuple or None
        sRGB colors of the file's channels, as far as it states them; if they are all the same, they do not count.

    Returns
    -------
    (3,) tuple of float or None
        Scene-linear RGB.
    """
    if count < 2:
        return None
    own = stated[number] if number < len(stated) and len(set(stated[:count])) > 1 else None
    return linear(own if own is not None and any(own) else CONVENTION[number % len(CONVENTION)])


def ome_colors(description: str) -> tuple:
    """The colors that the OME-XML of one image states for its channels, sRGB or None for each.

    ``Color`` is a signed number of 32 bits, red in its highest byte and alpha in its lowest (OME schema 2016-06). White
    is its default. Without another color, the band of ``EmissionWavelength`` counts.
    """
    found = []
    for channel in OME_CHANNEL.findall(description):
        color, emission = OME_COLOR.search(channel), OME_EMISSION.search(channel)
        packed = int(color[1]) & 0xFFFFFFFF if color else 0xFFFFFFFF
        rgb = tuple((packed >> shift & 0xFF) / 255.0 for shift in (24, 16, 8))
        if rgb == (1.0, 1.0, 1.0):
            rgb = None
            if emission:
                rgb = next((band for end, band in BANDS if float(emission[1]) < end), FAR_RED)
        found.append(rgb)
    return tuple(found)


def hex_colors(texts) -> tuple:
    """The colors of hexadecimal texts such as "00FF00", sRGB; None for each that is another one."""
    return tuple(
        tuple(int(text[i : i + 2], 16) / 255.0 for i in (0, 2, 4))
        if isinstance(text, str) and re.fullmatch("[0-9a-fA-F]{6}", text) else None
        for text in texts
    )  # fmt: skip
