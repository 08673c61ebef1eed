"""What a compressed frame says of itself, read before any decoder sees it."""

import struct
from dataclasses import dataclass

START_OF_SCAN = 0xDA
# Frame headers: ITU T.81 table B.1 (SOF0 to SOF15 without DHT, JPG, DAC) and T.87 (SOF55, JPEG-LS).
FRAME_MARKERS = {*range(0xC0, 0xD0), 0xF7} - {0xC4, 0xC8, 0xCC}
J2K_START = b"\xff\x4f\xff\x51"  # SOC and SIZ, ITU T.800 annex A
JP2_START = b"\0\0\0\x0cjP  "
SEARCHED = 4096  # bytes of a JP2 file's boxes before its codestream


@dataclass(frozen=True)
class CodeHeader:
    """Size of a compressed picture. ``precision``: bits of each sample."""

    rows: int
    columns: int
    components: int
    precision: int


def code_header(data: bytes) -> CodeHeader | None:
    """Header of a JPEG, JPEG-LS or JPEG 2000 codestream; None if there is none or it is damaged."""
    if data[:2] == b"\xff\xd8":
        return _jpeg_header(data)
    start = data.find(J2K_START, 0, SEARCHED) if data[:8] == JP2_START else 0
    if start >= 0 and data[start : start + 4] == J2K_START:
        return _j2k_header(data[start + 4 :])
    return None


def _jpeg_header(data: bytes) -> CodeHeader | None:
    at = 2
    while at + 4 <= len(data):
        if data[at] != 0xFF:
            return None
        marker = data[at + 1]
        if marker == 0xFF:  # fill byte
            at += 1
            continue
        length = struct.unpack(">H", data[at + 2 : at + 4])[0]
        if marker in FRAME_MARKERS and at + 10 <= len(data):
            precision, rows, columns, components = struct.unpack(">BHHB", data[at + 4 : at + 10])
            return CodeHeader(rows, columns, components, precision)
        if marker == START_OF_SCAN or length < 2:
            return None
        at += 2 + length
    return None


def _j2k_header(data: bytes) -> CodeHeader | None:
    """``data`` begins with the length of SIZ."""
    if len(data) < 39:
        return None
    _, _, right, bottom, left, top = struct.unpack(">HHIIII", data[:20])
    components, precision, across, down = *struct.unpack(">H", data[36:38]), *data[38:41]
    if (across, down) != (1, 1):
        return None
    return CodeHeader(bottom - top, right - left, components, (precision & 0x7F) + 1)
