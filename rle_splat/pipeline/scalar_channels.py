"""Further channels of a post-classified scan: what is known of each beside the volume itself."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..classify.classification import opacity_distance
from ..classify.lookup_table import LookupTable, extinction_steps, lookup_table
from ..classify.points import LARGEST
from ..classify.relevant import Reach
from ..classify.visible import VisibleVoxels
from ..encode.scalars import center_of, scalars_of
from ..volume.blocks import Blocks

if TYPE_CHECKING:
    from ..classify.transfer_function import TransferFunction
    from ..volume.volume import Volume


@dataclass(frozen=True, eq=False)
class ScalarChannel:
    """One volume and its transfer function on kept voxels.

    Attributes
    ----------
    voxels : VisibleVoxels
        The kept voxels of all channels, with this one's stored values.
    reach : Reach
        Of what it shows.
    ends : tuple of float
        Smallest and largest stored value that is splatted.
    infinite : tuple of float
        Stored values that stand for minus and plus infinity; empty where nothing is infinite.
    """

    volume: Volume
    function: TransferFunction
    voxels: VisibleVoxels
    reach: Reach
    ends: tuple
    infinite: tuple
    transfer: LookupTable

    @property
    def center(self) -> float:
        """What is taken from stored values before they are splatted."""
        return center_of(self.volume.voxels.dtype, self.ends)

    @property
    def values_key(self) -> tuple:
        """What ``scalars`` depend on beside the kept voxels."""
        return self.infinite, self.center

    def extinction_steps(self):
        """Generator of fractions done: (m,) float32 of the voxels, 1 / world length."""
        return extinction_steps(self.transfer, self.voxels.stored, self.volume.voxels.dtype, self.infinite)

    def scalars(self) -> np.ndarray:
        """(m,) stored values less ``center``: see ``encode.scalars.scalars_of``."""
        return scalars_of(self.voxels, self.volume.voxels.dtype, *self.values_key)


def center_ends(reach: Reach, center: float) -> np.ndarray:
    """(k, 2) float64: ``reach.ends`` less ``center``, finite."""
    with np.errstate(over="ignore"):
        return np.clip(reach.ends.astype(np.float64) - center, -LARGEST, LARGEST)


def find_value_ends(volume, tf, blocks: Blocks) -> tuple[tuple, tuple]:
    """Smallest and largest stored value that is splatted, and what stands for minus and plus infinity.

    These are the transfer function's ends, beyond which nothing changes; empty where nothing is infinite.
    """
    (least, most), infinite = blocks.finite_range, ()
    if blocks.holds_infinite:
        points = [(value - volume.intercept) / volume.slope for value, *_ in (*tf.opacity, *tf.color)]
        infinite = min(points), max(points)
        # Blocks that hold infinite values do not tell their finite ones.
        finite = sorted((value - volume.intercept) / volume.slope for value in volume.value_range)
        least, most = min(finite[0], infinite[0]), max(finite[1], infinite[1])
    return (least, most) if least <= most else (0.0, 0.0), infinite


def join_values(channels) -> np.ndarray:
    """(m, channels) float32: the scalars of each."""
    return np.stack([channel.scalars() for channel in channels], axis=1, dtype=np.float32, casting="unsafe")


def make_channel_table(grid, volume, function, ends, length: float) -> LookupTable:
    """The lookup table of a channel on a volume's ``grid``, whose spacing opacities refer to by themselves."""
    return lookup_table(volume, function, ends, opacity_distance(grid, function, length))
