"""A block of samples that several channels classify: extinctions add up, and colors are averaged by extinction.

Each channel's samples are added in turn to ``scratch.BlockScratch.mixed``, blocks of extinction * RGB, extinction, the
share of the slab that counts, the usual share of its sheet, and where what is shown of the slab begins and ends.  The
last two are averaged by extinction.
"""

from __future__ import annotations

import numpy as np

from ..runtime.jit import inner_loop
from .pixel_block import BLOCK
from .sample_block import SPAN_BEGIN, SPAN_END, USUAL

_SIGMA, _COUNTS, _USUAL, _BEGIN, _END = (BLOCK * plane for plane in range(3, 8))
_ZERO, _ONE = np.float32(0.0), np.float32(1.0)


@inner_loop
def add_samples(sampled, shares, mixed):
    """Add one channel's samples; ``sampled``, ``shares``: of ``scalar_block.classify_values`` and ``look_between``."""
    for i in range(BLOCK):
        counts = shares[i]
        sigma = sampled[_SIGMA + i] * counts
        total = mixed[_SIGMA + i] + sigma
        part = sigma / total if total > _ZERO else _ZERO
        for plane in range(3):
            mixed[BLOCK * plane + i] += sampled[BLOCK * plane + i] * counts
        mixed[_SIGMA + i] = total
        # A slab counts half where a channel has a value at one of its ends only; mostly all channels have both.
        more = counts > mixed[_COUNTS + i]
        mixed[_COUNTS + i] = counts if more else mixed[_COUNTS + i]
        mixed[_USUAL + i] = shares[BLOCK * USUAL + i] if more else mixed[_USUAL + i]
        mixed[_BEGIN + i] += part * (shares[BLOCK * SPAN_BEGIN + i] - mixed[_BEGIN + i])
        mixed[_END + i] += part * (shares[BLOCK * SPAN_END + i] - mixed[_END + i])


@inner_loop
def finish_mixing(mixed, sampled, shares):
    """Put the sums where one channel's samples and shares would be."""
    for i in range(BLOCK):
        counts = mixed[_COUNTS + i]
        for plane in range(4):
            sampled[BLOCK * plane + i] = mixed[BLOCK * plane + i] * (_ONE / counts)
        shares[i] = counts
        shares[BLOCK * USUAL + i] = mixed[_USUAL + i]
        shares[BLOCK * SPAN_BEGIN + i] = mixed[_BEGIN + i]
        shares[BLOCK * SPAN_END + i] = mixed[_END + i]
