"""Memory that large arrays leave, for those that come.

The system clears every page that a process takes, and gets back at once what the largest arrays leave.  While a
transfer function is dragged about, each picture's results replace earlier ones of nearly the same size, and clearing
was a fifth of a picture's time (measured: X-ray foot, 5 million voxels, 30 of 160 ms).  So do the intermediate images
of large pictures (10 of 74 ms: CT bonsai, 1920 x 1080, fine).
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

# Bytes of the arrays that this is about.  The memory of smaller ones stays with the process as it is (glibc: up to 32
# MiB), that of larger ones would be much to hold in vain.
LEAST, MOST = 1 << 25, 1 << 27
# Sizes are whole parts of the power of two below: what grows a little finds room in what it left.  (What an array has
# too much, at most a third, is never written to, so the system need not find it.)
PARTS = 2


class _Loan:
    """Memory that an array and all its views use; idle when the last of them is gone."""

    idle: deque[np.ndarray] = deque()  # what was left first comes first
    most_idle = 1 << 28  # bytes

    def __init__(self, memory: np.ndarray, size: int):
        self.memory = memory
        self.__array_interface__ = memory[:size].__array_interface__

    def __del__(self):
        self.idle.append(self.memory)
        try:
            while sum(memory.size for memory in tuple(self.idle)) > self.most_idle:
                self.idle.popleft()
        except (IndexError, RuntimeError):  # another thread was quicker, or left memory meanwhile and saw to it itself
            pass


def empty(shape, dtype) -> np.ndarray:
    """As ``np.empty``, in memory that another array left where there is some that fits."""
    dtype = np.dtype(dtype)
    size = math.prod(np.atleast_1d(shape).tolist()) * dtype.itemsize
    if not LEAST <= size <= MOST:
        return np.empty(shape, dtype)
    return np.asarray(_Loan(_memory(size), size)).view(dtype).reshape(shape)


def forget() -> None:
    """Give back what no array uses."""
    _Loan.idle.clear()


def _memory(size: int) -> np.ndarray:
    """Bytes, ``size`` or up to half as many more."""
    part = (1 << (size - 1).bit_length() - 1) // PARTS
    whole = -(-size // part) * part
    for _ in range(len(_Loan.idle)):
        try:
            memory = _Loan.idle.popleft()  # nobody else's from now on, whatever other threads do
        except IndexError:
            break
        if memory.size == whole:
            return memory
        _Loan.idle.append(memory)
    # What fits nothing goes back first: the system is quicker to give that away again than what was never used.
    given_back = 0
    while given_back < whole and _Loan.idle:
        try:
            given_back += _Loan.idle.popleft().size
        except IndexError:
            break
    return np.empty(whole, np.uint8)
