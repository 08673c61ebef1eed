"""What is worth knowing about a volume, as lines of text and a histogram that a panel can show without the voxels."""

import json
import os
from dataclasses import dataclass

import numpy as np

from ..rle_splat.volume.histogram import histogram

BINS = 256


def write_facts(volume_object, volume) -> None:
    """Fill the object's facts, remarks, value range and histogram from its volume."""
    properties = volume_object.rle_splat
    counted = histogram(volume, BINS)
    low, high = volume.value_range
    properties.value_low, properties.value_high = low, high
    properties.value_unit = volume.value_unit or ""
    properties.length_unit = volume.unit
    properties.facts = "\n".join(fact_lines(volume, os.path.basename(properties.filepath.replace("\\", "/"))))
    properties.remarks = "\n".join(volume.remarks)
    properties.histogram = json.dumps({"edges": [float(counted.edges[0]), float(counted.edges[-1])],
                                       "counts": counted.counts.tolist()})


def fact_lines(volume, file_name: str) -> list[str]:
    """"Name: value" lines on a volume's file, grid, size and values."""
    unit = volume.unit
    extent = (np.array(volume.shape_xyz) - 1) * volume.spacing
    low, high = volume.value_range
    value_unit = f" {volume.value_unit}" if volume.value_unit else ""
    lines = [
        f"File: {file_name}",
        f"Voxels: {_by(volume.shape_xyz)}, {volume.voxels.dtype.name}",
        f"Spacing: {_by(volume.spacing)} {unit}",
        f"Box: {_by(extent)} {unit}",
        f"Values: {low:.6g} to {high:.6g}{value_unit}",
        f"In Memory: {memory_text(volume.voxels.nbytes)}",
    ]
    if volume.modality:
        lines.insert(1, f"Modality: {volume.modality}")
    return lines


def _by(numbers) -> str:
    return " × ".join(f"{n:.6g}" for n in numbers)


def memory_text(count: int) -> str:
    """A number of bytes for people, in binary multiples."""
    size = float(count)
    for unit in ("bytes", "KiB", "MiB"):
        if size < 1024.0:
            return f"{size:.4g} {unit}"
        size /= 1024.0
    return f"{size:.4g} GiB"


@dataclass(frozen=True)
class StoredHistogram:
    """Counts (n,) int64 over equal bins from ``low`` to ``high``, physical values."""

    counts: np.ndarray
    low: float
    high: float


def stored_histogram(properties) -> StoredHistogram | None:
    """The histogram kept on the object, or None before an import filled it."""
    if not properties.histogram:
        return None
    kept = json.loads(properties.histogram)
    return StoredHistogram(np.array(kept["counts"], dtype=np.int64), *kept["edges"])
