"""Scanlines as bits, one a voxel: runs begin and end where a bit differs from the one before.

What lies along y is found a strip at a time, 64 rows of a plane z: a word of each of the scanlines that cross it.

Throughout: ``bits``, ``row_start`` and ``column`` are of ``classify.visible.VisibleVoxels``; ``bits`` are None where
there are none, and found from the columns.
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
    """How many words the bits of a scanline take."""
    return -(-voxels // WORD)


@inner_loop
def read_row(bits, row_start, column, row, words):
    """The bits of a row along x, in ``words`` (n,) uint64."""
    if bits is not None:
        for n in range(words.size):
            words[n] = bits[row, n]
    else:
        words[:] = NO_BITS
        at, word = np.int64(0), NO_BITS
        for i in range(row_start[row], row_start[row + 1]):
            x = np.int64(column[i])
            if x // WORD != at:  # a word is put together in a register: memory just written takes time to read
                words[at] = word
                at, word = x // WORD, NO_BITS
            word |= ONE_BIT << np.uint64(x % WORD)
        words[at] = word


@inner_loop
def read_strip(bits, row_start, column, row, rows, words):
    """The bits along x of ``rows`` rows from ``row`` on, 64 at most, in ``words`` (64, n); none in those left over."""
    for j in range(rows):
        read_row(bits, row_start, column, row + j, words[j])
    words[rows:] = NO_BITS


@inner_loop
def turn_words(words, n, block):
    """Word ``n`` of the rows of a strip turned: bit j of ``block[i]`` (64,) is bit i of row j.  Returns whether any is
    set."""
    seen = NO_BITS
    for j in range(WORD):
        seen |= words[j, n]
        block[j] = words[j, n]
    if seen == NO_BITS:
        return False
    # Squares of 32 by 32 bits change places, then of 16 by 16 in each of them, and so on.
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


@inner_loop(forceinline=True)
def write_runs(word, before, first, end, runs, run):
    """The runs that end in a word of a scanline, whose first bit is voxel ``first``, to ``runs`` from ``run`` on.

    ``before``: the bit before, in the last place; ``end``: where the last run ended.  Returns where the next run goes,
    and where the last one ended.
    """
    edges = word ^ ((word << ONE_BIT) | before)
    while edges != NO_BITS:
        x = first + lowest_bit(edges)
        edges &= edges - ONE_BIT
        runs[run] = x - end
        run += 1
        end = x
    return run, end
