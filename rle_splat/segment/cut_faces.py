"""The faces of cuts: what a volume shows where a plane or a box cuts it.

A face is a slice, see ``slices``. It shows the values that the volume shows, and what these enclose.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from .masks import label_parts


@dataclass(frozen=True)
class CutFace:
    """What decides which part of a face is shown.

    Attributes
    ----------
    shown : tuple of (float, float)
        Half-open intervals of physical values that are visible.
    cuts : tuple of (bool, tuple of (float, float, float, float))
        The other cuts of the volume: whether a box is cut away, and its half-spaces in voxel indices, whose values are
        distances in voxels, at most 0 inside; without that only what is inside stays.
    shown_of : tuple of (tuple of (float, float), tuple of int)
        The visible values, none of hidden ones, of labels with values of their own.
    labels_key : object
        Tells one label map from another.
    labels : (nz, ny, nx) ndarray of int or None
    """

    shown: tuple
    cuts: tuple = ()
    shown_of: tuple = ()
    labels_key: object = None
    labels: np.ndarray | None = field(default=None, compare=False)


def face_matrices(kind: str) -> list[np.ndarray]:
    """The faces of a plane or a box.

    Parameters
    ----------
    kind : {"plane", "box"}
        Of a ``Clip``, in whose own space a box reaches from -1 to 1.

    Returns
    -------
    list of (4, 4) ndarray of float64
        Of one face or six: a rectangle's space, from -1 to 1 in x and y, to the clip's own. Its z points out of the
        box, or along the plane's.
    """
    if kind == "plane":
        return [np.eye(4)]
    found = []
    for axis in range(3):
        for side in (-1.0, 1.0):
            matrix = np.eye(4)
            matrix[:3, :3] = np.roll(np.eye(3), axis + 1, axis=0)  # z to the axis
            matrix[:3, 2] *= side
            matrix[axis, 3] = side
            found.append(matrix)
    return found


def plane_around(volume, matrix: np.ndarray) -> np.ndarray:
    """The plane of a face, as wide as the volume.

    Parameters
    ----------
    matrix : (4, 4) ndarray of float64
        The face's space to voxel indices.

    Returns
    -------
    (4, 4) ndarray of float64
        As ``matrix``, with a rectangle that all of the volume on the plane lies in.
    """
    counts = np.array(volume.shape_xyz, dtype=np.float64)
    lengths = np.linalg.norm(matrix[:3, :2], axis=0)
    across, *_ = np.linalg.lstsq(matrix[:3, :2], 0.5 * (counts - 1.0) - matrix[:3, 3], rcond=None)
    wide = matrix.copy()
    wide[:3, :2] *= 0.5 * np.linalg.norm(counts) / np.where(lengths > 0.0, lengths, 1.0)
    wide[:3, 3] += matrix[:3, :2] @ across
    return wide


class Sampled(NamedTuple):
    """The values of a volume on a plane.

    Attributes
    ----------
    values : (height, width) ndarray of float64
        Physical values at the centers of the pixels.
    inside : (height, width) ndarray of bool
        Which pixels lie in the volume.
    matrix : (4, 4) ndarray of float64
        The space of the plane's rectangle to voxel indices.
    """

    values: np.ndarray
    inside: np.ndarray
    matrix: np.ndarray


def face_share(sampled: Sampled, around: Sampled, face: CutFace, is_filled: bool) -> np.ndarray:
    """How much of each pixel of a face is shown.

    The outline is that of the linear function which the values have around a pixel.

    Parameters
    ----------
    sampled, around : Sampled
        On the face, and on its ``plane_around`` with fewer pixels.
    is_filled : bool
        Whether what visible values enclose on the plane is shown, too.

    Returns
    -------
    (height, width) ndarray of float64
        0 to 1.
    """
    share = _visible(sampled, face)
    if is_filled:
        enclosed = _enclosed(_visible(around, face) > 0.5)[_pixels_of(sampled, around)]
        share[enclosed & sampled.inside] = 1.0
    x, y = _centers(share.shape)
    pixel = np.linalg.norm(sampled.matrix[:3, :2], axis=0).max() * 2.0 / max(share.shape)  # in voxels
    for is_hole, sides in face.cuts:
        beyond = [a * x + b * y + d for a, b, _, d in (np.array(sides) @ sampled.matrix).tolist()
                  if is_hole or abs(a) + abs(b) + d > -pixel]  # fmt: skip
        if beyond:
            room = np.max(beyond, axis=0) if is_hole else -np.max(beyond, axis=0)
            np.minimum(share, np.clip(0.5 + room / pixel, 0.0, 1.0), out=share)
    return share


def _pixels_of(sampled: Sampled, around: Sampled) -> tuple:
    """The pixels around that those of a face lie in, as an index; their axes are parallel."""
    to_around = np.linalg.pinv(around.matrix[:3, :2]) @ (sampled.matrix[:3] - around.matrix[:3] * (0.0, 0.0, 0.0, 1.0))
    height, width = around.values.shape
    x, y = _centers(sampled.values.shape)
    columns = 0.5 * width * (to_around[0, 0] * x + to_around[0, 3] + 1.0)
    rows = 0.5 * height * (1.0 - to_around[1, 1] * y[:, 0] - to_around[1, 3])
    return np.ix_(np.clip(rows.astype(int), 0, height - 1), np.clip(columns.astype(int), 0, width - 1))


def _centers(shape) -> tuple[np.ndarray, np.ndarray]:
    """x of the columns of pixels, and y of the rows, in the plane's space."""
    height, width = shape
    return (2.0 * np.arange(width) + 1.0) / width - 1.0, 1.0 - (2.0 * np.arange(height)[:, None] + 1.0) / height


def _visible(sampled: Sampled, face: CutFace) -> np.ndarray:
    """How much of each pixel is visible by its value and its label."""
    share = _visible_share(sampled.values, face.shown)
    if face.labels is not None:
        x, y = _centers(share.shape)
        places = (row[0] * x + row[1] * y + row[3] for row in sampled.matrix[2::-1])
        nearest = (np.clip(np.rint(place), 0, n - 1).astype(int) for place, n in zip(places, face.labels.shape))
        numbers = face.labels[tuple(nearest)]
        for shown, of in face.shown_of:
            share = np.where(np.isin(numbers, of), _visible_share(sampled.values, shown), share)
    return np.where(sampled.inside, share, 0.0)


def _visible_share(values: np.ndarray, shown) -> np.ndarray:
    """How much of each pixel has values in some intervals, by the distance to their ends and the gradient there."""
    if not shown:
        return np.zeros(values.shape)
    finite = np.isfinite(values)
    values = np.where(finite, values, 0.0)
    span = max(float(np.ptp(values)), 1e-30)
    depth = np.max([np.minimum(np.clip(values - low, -span, span), np.clip(high - values, -span, span))
                    for low, high in shown], axis=0)  # fmt: skip
    slope = np.hypot(*np.gradient(depth)) if min(values.shape) > 1 else np.zeros(values.shape)
    return np.where(finite, np.clip(0.5 + depth / np.maximum(slope, 1e-9 * span), 0.0, 1.0), 0.0)


def _enclosed(shown: np.ndarray) -> np.ndarray:
    """The pixels, beside those of the outline, that only gaps of two pixels at most connect to the border."""
    parts = label_parts(~_grown(np.pad(shown, 1))[None])[0]
    return ~_grown(_grown(parts == parts[0, 0]))[1:-1, 1:-1]


def _grown(mask: np.ndarray) -> np.ndarray:
    """A mask with the pixels beside it."""
    padded = np.pad(mask, 1)
    return padded[1:-1, 1:-1] | padded[:-2, 1:-1] | padded[2:, 1:-1] | padded[1:-1, :-2] | padded[1:-1, 2:]
