"""An encoder of lossless JPEG (ITU T.81, annex H), for tests where no library writes it: predictor 1, one table."""

import struct

import numpy as np

CATEGORIES = 17  # of differences, 0 to 16; each gets a Huffman code of five bits, its own number
CODE_BITS = 5


def encode(frame: np.ndarray, precision: int) -> bytes:
    """Codestream of gray values (rows, columns), of ``precision`` bits."""
    rows, columns = frame.shape
    counts = bytes(CATEGORIES if length == CODE_BITS else 0 for length in range(1, 17))
    return b"".join([
        b"\xff\xd8",
        _segment(0xC3, struct.pack(">BHHB3B", precision, rows, columns, 1, 1, 0x11, 0)),
        _segment(0xC4, b"\0" + counts + bytes(range(CATEGORIES))),
        _segment(0xDA, bytes([1, 1, 0, 1, 0, 0])),
        _scan(_differences(frame.astype(np.int64), precision)),
        b"\xff\xd9",
    ])  # fmt: skip


def _segment(marker: int, payload: bytes) -> bytes:
    return struct.pack(">BBH", 0xFF, marker, len(payload) + 2) + payload


def _differences(frame: np.ndarray, precision: int) -> np.ndarray:
    """Each value minus its left neighbor, in the first column minus the one above; modulo 65536, -32767 to 32768."""
    left = np.empty_like(frame)
    left[:, 1:] = frame[:, :-1]
    left[1:, 0] = frame[:-1, 0]
    left[0, 0] = 1 << (precision - 1)
    return (frame - left + 32767) % 65536 - 32767


def _scan(differences: np.ndarray) -> bytes:
    """Entropy-coded data: a category, then its low bits; 0xFF is followed by 0."""
    bits = []
    for difference in differences.reshape(-1).tolist():
        category = abs(difference).bit_length()
        bits.append(f"{category:0{CODE_BITS}b}")
        if 0 < category < 16:
            low = difference if difference > 0 else difference + (1 << category) - 1
            bits.append(f"{low:0{category}b}")
    text = "".join(bits)
    text += "1" * (-len(text) % 8)
    return int(text, 2).to_bytes(len(text) // 8, "big").replace(b"\xff", b"\xff\0")
