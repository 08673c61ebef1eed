"""Modality LUT: a table from stored to physical values, in place of slope and intercept (DICOM PS3.3, C.11.1)."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from . import elements as read

MOST_ENTRIES = 1 << 16
BITS = (8, 16)


@dataclass(frozen=True)
class Table:
    """Values of the stored values ``first``, ``first`` + 1, ...; beyond its ends, those of the ends.

    ``values``: (entries,) 16-bit words in native order, as bytes, so that tables can be compared.
    """

    first: int
    values: bytes

    def physical(self, stored: np.ndarray) -> np.ndarray:
        """Values of stored integers, float32."""
        table = np.frombuffer(self.values, np.uint16).astype(np.float32)
        return table[np.clip(stored.astype(np.int64) - self.first, 0, len(table) - 1)]


@lru_cache(maxsize=8)
def _share_table(table: Table) -> Table:
    """The same object for equal tables: most files of a series hold the same one."""
    return table


def table_of(found: read.Elements) -> tuple[Table | None, str]:
    """The table of a file, and the unit of its values, "" if it says none; call it within ``elements.quiet``.

    Returns
    -------
    table : Table or None
        None if the file has none, or one whose parts do not fit together.
    unit : str
    """
    item = read.item(found.dataset, "ModalityLUTSequence")
    descriptor, data = (_words(item, name, found.little_endian) for name in ("LUTDescriptor", "LUTData"))
    if descriptor is None or data is None or len(descriptor) != 3:
        return None, ""
    entries, first, bits = (int(word) for word in descriptor)
    entries = entries or MOST_ENTRIES
    if read.whole(found.dataset, "PixelRepresentation", 0) == 1 and first >= 1 << 15:
        first -= 1 << 16
    if bits == BITS[0] and len(data) == -(-entries // 2):  # two entries in each word
        data = data.astype("<u2").view(np.uint8)[:entries].astype(np.uint16)
    if bits not in BITS or len(data) != entries:
        return None, ""
    kind = read.text(item, "ModalityLUTType")
    return _share_table(Table(first, data.astype(np.uint16).tobytes())), "HU" if kind == "HU" else ""


def _words(item, name: str, little_endian: bool) -> np.ndarray | None:
    """An element's 16-bit words, unsigned; None if it is absent or of another kind."""
    found = read.value(item, name)
    if isinstance(found, bytes):
        return np.frombuffer(found[: len(found) // 2 * 2], "<u2" if little_endian else ">u2")
    numbers = read.numbers(item, name)
    return None if numbers is None else (np.array(numbers).astype(np.int64) & 0xFFFF).astype(np.uint16)
