"""Scanlines as bit fields, one bit per voxel; runs begin and end where a bit differs from the previous one.

Scanlines along y are processed in strips of 64 rows of a plane z: one word of each scanline that crosses the strip.
``bits``: of ``classify.visible.VisibleVoxels``.
"""

from __future__ import annotations

import numpy as np

from ..runtime.bits import lowest_bit
from ..runtime.jit import inner_loop

WORD = 64
NO_BITS, ONE_BIT, ALL_BITS = np.uint64(0), np.uint64(1), np.uint64(2**64 - 1)
LAST_BIT = np.uint64(WORD - 1)


@inner_loop
def word_count(voxels):
    """Words per scanline."""
    return -(-voxels // WORD)


@inner_loop
def read_strip(bits, row, rows, words):
    """Read the bits of ``rows`` rows (at most 64) from ``row`` on to ``words`` (64, n); the other rows become zero."""
    for j in range(rows):
        for n in range(words.shape[1]):
            words[j, n] = bits[row + j, n]
    words[rows:] = NO_BITS


@inner_loop
def turn_words(words, n, block):
    """Transpose word ``n`` of a strip: bit j of ``block[i]`` (64,) becomes bit i of row j.

    Returns whether any bit is set.
    """
    seen = NO_BITS
    for j in range(WORD):
        seen |= words[j, n]
        block[j] = words[j, n]
    if seen == NO_BITS:
        return False
    # Swap squares of 32 x 32 bits, then of 16 x 16 in each of them, and so on.
    size = np.uint64(WORD // 2)
    mask = ALL_BITS >> size
    while size != NO_BITS:
        count = np.int64(size)
        i = 0
        while i < WORD:
            both = ((block[i] >> size) ^ block[i + count]) & mask
            block[i] ^= both << size
            block[i + count] ^= both
            i = (i + count + 1) & ~count
        size >>= ONE_BIT
        mask ^= mask << size
    return True


@inner_loop
def write_runs(word, before, first, end, runs, run):
    """Write the runs that end in a word of a scanline, whose first bit is voxel ``first``, to ``runs`` from ``run`` on.

    ``before``: the previous bit, in bit 0; ``end``: where the last run ended. Returns the position of the next run, and
    where the last run ended.
    """
    edges = word ^ ((word << ONE_BIT) | before)
    while edges != NO_BITS:
        x = first + lowest_bit(edges)
        edges &= edges - ONE_BIT
        runs[run] = x - end
        run += 1
        end = x
    return run, end
