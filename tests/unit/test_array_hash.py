"""A hash of an array is computed once where nobody can write to it, and never outlives it."""

import gc

import numpy as np
import pytest

from rle_splat.runtime import array_hash
from rle_splat.runtime.array_hash import hash_array


@pytest.fixture
def hashed(monkeypatch):
    """How often elements were hashed, as a list."""
    found, make = [], array_hash.hashlib.blake2b
    monkeypatch.setattr(array_hash.hashlib, "blake2b", lambda *a, **more: (found.append(1), make(*a, **more))[1])
    return found


def test_an_array_that_can_be_written_to_is_hashed_each_time(hashed):
    array = np.arange(12.0)
    before = hash_array(array)
    array[3] = 7.0
    assert hash_array(array) != before and len(hashed) == 2


def test_a_read_only_array_is_hashed_once_and_as_its_copy(hashed):
    array = np.arange(12.0)
    array.flags.writeable = False
    assert hash_array(array) == hash_array(array) and len(hashed) == 1
    assert hash_array(array.copy()) == hash_array(array) and len(hashed) == 2


def test_an_array_that_is_made_writeable_again_is_hashed_again():
    array = np.arange(12.0)
    array.flags.writeable = False
    before = hash_array(array)
    array.flags.writeable = True
    array[0] = 5.0
    assert hash_array(array) != before


def test_a_view_of_other_elements_is_hashed_each_time():
    """Others may write to them."""
    array = np.arange(12.0)
    view = array[2:]
    view.flags.writeable = False
    before = hash_array(view)
    array[3] = 9.0
    assert hash_array(view) != before


def test_hashes_go_with_their_arrays():
    array = np.arange(12.0)
    array.flags.writeable = False
    hash_array(array)
    count = len(array_hash._hashes)
    del array
    gc.collect()
    assert len(array_hash._hashes) == count - 1
