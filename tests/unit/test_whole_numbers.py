"""Kernels get whole numbers of 64 bits where numpy's own have 32, as those of numpy 1.26 have on Windows.

Other types would be other kernels, which nothing brings.
"""

from types import SimpleNamespace

import numpy as np
import pytest

from rle_splat.pipeline import lit_scalars
from rle_splat.splat import arguments, label_fields
from rle_splat.splat.arguments import ChannelLookups, Lookup
from rle_splat.view import clip_intervals


@pytest.fixture
def short(monkeypatch):
    """``short(module)``: numpy in it makes whole numbers of 32 bits unless a type is given."""

    def shorten(module):
        def cut(name):
            def made(*values, dtype=None, **options):
                found = getattr(np, name)(*values, dtype=dtype, **options)
                return found.astype(np.int32) if dtype is None and found.dtype == np.int64 else found

            return made

        def array(values, dtype=None):
            return cut("array")(values, dtype=dtype)

        feigned = SimpleNamespace(**{**vars(np), "cumsum": cut("cumsum"), "arange": cut("arange"), "array": array})
        monkeypatch.setattr(module, "np", feigned)

    return shorten


def test_those_of_several_lookup_tables(short):
    short(arguments)
    one = Lookup(np.zeros(8, np.float32), np.zeros(8, np.float32), *map(np.float32, range(7)), np.int32(1))
    lookups = ChannelLookups.of([one], [one, one], 2)
    assert (lookups.planes.dtype, lookups.begins.dtype) == (np.int64, np.int64)
    assert lookups.planes.tolist() == [0, 2, 3] and lookups.begins.tolist() == [0, 8, 16, 24]


def test_those_of_label_fields(short, monkeypatch):
    short(label_fields)
    monkeypatch.setattr(label_fields, "cell_field", lambda cells: None)
    plane = SimpleNamespace(
        axis=2, sign=1, reference=0.0, points=(np.zeros(3), np.zeros(2)), ray_slopes=(np.zeros(3), np.zeros(2))
    )
    field = label_fields.label_field(SimpleNamespace(shape_xyz=(4, 5, 6)), plane)
    assert (field.counts.dtype, field.strides.dtype) == (np.int64, np.int64)
    assert sorted(field.counts.tolist()) == [4, 5, 6] and sorted(field.strides.tolist()) == [1, 4, 20]


def test_those_of_channels_along_rays(short, monkeypatch):
    short(lit_scalars)
    monkeypatch.setattr(lit_scalars, "center_ends", lambda reach, center: np.zeros((3, 2)))
    given = SimpleNamespace(
        channels=[SimpleNamespace(reach=None, center=0.0)] * 2, values_key="key",
        work=SimpleNamespace(job=SimpleNamespace(get=lambda *_: np.zeros((1, 2), np.float32))),
    )  # fmt: skip
    begins = lit_scalars.LitScalars._channel_rows(given).begins
    assert begins.dtype == np.int64 and begins.tolist() == [0, 3, 6]


def test_those_of_cuts(short, monkeypatch):
    short(clip_intervals)
    monkeypatch.setattr(clip_intervals, "_crossings", lambda plane, sides: ())
    monkeypatch.setattr(clip_intervals, "compiled", lambda: False)
    monkeypatch.setattr(clip_intervals.reference, "clip", lambda crossings, bodies, intervals: bodies)
    cuts = clip_intervals.Cuts(np.zeros((6, 4)), (np.zeros((1, 4)), np.zeros((6, 4))))
    bodies = clip_intervals.clip_intervals(SimpleNamespace(width=2, height=2), cuts)
    assert bodies.dtype == np.int64 and bodies.tolist() == [6, 7, 13]
