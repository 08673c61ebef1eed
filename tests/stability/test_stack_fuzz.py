"""DICOM slices whose numbers jitter, at the borders of rounding too: each is in the volume, where it belongs."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from rle_splat.read.dicom import stacking
from rle_splat.read.dicom.grouping import groups_of
from rle_splat.read.dicom.pictures import ImageFrame, Series, Storage
from tests.stability.fuzz import examples

ROWS, COLUMNS = 512, 400
OBLIQUE = (0.707149, 0.0, -0.707064, 0.0, 1.0, 0.0)  # as scanners round them
TURNS = {"axial": (1.0, 0.0, 0.0, 0.0, 1.0, 0.0), "oblique": OBLIQUE, "half": (0.6, 0.8, 0.0, 0.0, 0.0, -1.0)}
# Borders of rounding to 1e-4, 2e-3 and 0.1, from which the next number is 1e-6 away.
AT_BORDERS = st.sampled_from([0.48825, 0.70715, 0.00005, 0.001, 0.05, 0.15, 1.25, 0.7])


def picture(i: int, position, orientation, spacing=(0.5, 0.5), **apart) -> ImageFrame:
    storage = Storage(
        Path(f"{i}.dcm"), "1.2.840.10008.1.2.1", True, "integer", 0, 0, False, 0, ROWS, COLUMNS, 1, 16, 16, 15, False
    )
    series = Series("key", f"{i}", "", 1, "CT", "", "", None, False, False, None, None, None)
    numbers = (tuple(map(float, values)) for values in (position, orientation, spacing))
    return ImageFrame(storage, series, 0, i, *numbers, 1.0, 0.0, None, False, "", apart)


def grouped(pictures, seed: int = 0):
    """The groups of pictures that come in any order."""
    order = np.random.default_rng(seed).permutation(len(pictures))
    return groups_of([pictures[i] for i in order], lambda a, b: False)


def positions_of(steps, orientation, shear=0.0, origin=(0.0, 0.0, 0.0)) -> np.ndarray:
    row, _, normal = stacking.axes(orientation)
    return np.asarray(origin) + np.asarray(steps)[:, None] * (normal + shear * row)


@given(
    st.sampled_from(sorted(TURNS)), AT_BORDERS, st.integers(3, 40), st.floats(0.3, 12.0),
    st.sampled_from([0.0, 1e-7, 2e-6, 5e-5, 4e-4]), st.integers(0, 999), st.sampled_from([0.0, 0.3]),
)  # fmt: skip
@example("oblique", 0.48825, 9, 2.0, 2e-6, 1, 0.0)
@examples(100)
def test_numbers_that_jitter_make_one_series(turn, spacing, count, step, jitter, seed, shear):
    """No border parts slices, none is interpolated, and the grid is where the files say, to what jitter moves."""
    noise = np.random.default_rng(seed).uniform(-jitter, jitter, (count, 11))
    orientations = np.asarray(TURNS[turn]) + noise[:, :6]
    spacings = spacing * (1.0 + noise[:, 6:8])
    positions = positions_of(np.arange(count) * step, TURNS[turn], shear, (spacing, -spacing, 0.0)) + noise[:, 8:]
    (group,) = grouped([picture(i, *numbers) for i, numbers in enumerate(zip(positions, orientations, spacings))], seed)
    stack = group.stack()
    assert [one.instance_number for one in group.frames[0]] == list(range(count))
    assert stack.kind == "even" and stack.slices == count and not stack.filled.size
    edges = np.array([COLUMNS - 1.0, ROWS - 1.0])
    for i in range(count):
        for x, y in ((0, 0), (1, 0), (0, 1), (1, 1)):
            sides = orientations[i].reshape(2, 3) * (spacings[i][::-1] * edges * (x, y))[:, None]
            placed = (stack.affine @ (x * edges[0], y * edges[1], i, 1.0))[:3]
            assert np.linalg.norm(placed - positions[i] - sides.sum(axis=0)) <= stack.moved + 1e-9


@given(
    st.floats(0.02, 12.0), st.lists(st.sampled_from([1, 1, 1, 2, 3, 4]), min_size=2, max_size=60), st.integers(0, 999),
    st.sampled_from([0.0, 0.1, 0.45]), st.sampled_from(sorted(TURNS)),
)  # fmt: skip
@example(0.02, [1, 2], 0, 0.0, "axial")  # a gap of two steps that are smaller than what files round to
@examples(130)
def test_gaps_are_filled_and_no_slice_is_replaced(step, gaps, seed, jitter, turn):
    """Missing slices are seen beside distances that jitter by a part of what is allowed, in long stacks too."""
    numbers = np.concatenate([[0], np.cumsum([*gaps, 1])])
    most = jitter * min(stacking.EVEN_FRACTION * step, stacking.MOST_MM)
    off = np.random.default_rng(seed).uniform(-most, most, len(numbers))
    positions = positions_of(numbers * step + off, TURNS[turn])
    stack = stacking.stack(positions, [TURNS[turn]] * len(numbers), [(0.5, 0.5)] * len(numbers), (ROWS, COLUMNS))
    assert stack.kind == ("even" if max(gaps) == 1 else "missing")
    kept = np.setdiff1d(np.arange(stack.slices), stack.filled)
    np.testing.assert_array_equal(kept, numbers)
    np.testing.assert_array_equal(stack.below[kept], np.arange(len(numbers)))
    assert stack.moved <= stacking.MOST_MM


@given(st.lists(st.floats(0.003, 20.0), min_size=1, max_size=30), st.integers(0, 999))
@examples(130)
def test_any_distances_keep_every_slice_or_say_so(gaps, seed):
    """Where slices are not resampled, each is in the grid at most 0.1 mm from its place."""
    steps = np.concatenate([[0.0], np.cumsum(gaps)])
    (group,) = grouped([picture(i, at, TURNS["half"]) for i, at in enumerate(positions_of(steps, TURNS["half"]))], seed)
    stack = group.stack()
    if stack.kind == "irregular":
        return
    kept = np.setdiff1d(np.arange(stack.slices), stack.filled)
    np.testing.assert_array_equal(stack.below[kept], np.arange(len(steps)))
    placed = np.linalg.norm(stack.affine[:3, 2]) * kept
    assert np.abs(placed - steps).max() <= stack.moved + 1e-9 <= stacking.MOST_MM + 2e-9


@given(st.floats(-0.02, 0.02), st.sampled_from([0.05, 40.05, 40.15, -7.25]), st.integers(0, 999))
@examples(40)
def test_stacks_side_by_side_are_not_parted_at_borders(jitter, beside, seed):
    """Two stacks whose offsets jitter around a border of 0.1 mm are two volumes, or one if they are that close."""
    noise = jitter * np.random.default_rng(seed).uniform(-1.0, 1.0, (2, 8))
    points = [(beside * which + noise[which, i], 0.0, 2.0 * i + which) for which in (0, 1) for i in range(8)]
    groups = grouped([picture(i, point, TURNS["axial"]) for i, point in enumerate(points)], seed)
    assert [group.slices for group in groups] == ([8, 8] if abs(beside) > 1.0 else [16])
    for group in groups:
        assert group.stack().kind == "even"


@given(
    st.sampled_from(sorted(TURNS)), st.floats(-1.0, 1.0), st.integers(0, 999), st.sampled_from([0.0, 0.2, 0.49]),
    st.sampled_from(["trigger time", "acquisition time"]),
)  # fmt: skip
@examples(40)
def test_times_at_places_that_jitter_are_frames(turn, origin, seed, late, name):
    """Positions and the times of slices of one frame jitter, such as trigger times of the heart."""
    chance = np.random.default_rng(seed)
    noise = chance.uniform(-2.5e-4, 2.5e-4, (3, 7, 3))
    positions = positions_of(np.arange(7) * 0.8, TURNS[turn], 0.2, (origin, 0.001, -0.001)) + noise
    times = np.arange(3)[:, None] + late * chance.uniform(-1.0, 1.0, (3, 7))
    at_times = [picture(i, positions[t, i], TURNS[turn], **{name: times[t, i]}) for t in range(3) for i in range(7)]
    (group,) = grouped(at_times, seed)
    assert group.times == tuple(times.min(axis=1)) and group.axis == "time" and group.remarks == ()
    for frame in range(3):
        assert [one.instance_number for one in group.frames[frame]] == list(range(7))
        assert group.stack(frame).kind == "even"


@given(st.lists(st.tuples(*[st.floats(-3.0, 3.0)] * 3), min_size=1, max_size=40), st.floats(0.01, 1.0), st.randoms())
@examples(130)
def test_parts_at_gaps(points, gap, chance):
    """Points that are close are together, parts have a gap between them, and order does not matter."""
    points = np.array(points)
    parts = stacking.parts_at_gaps(points, gap)
    apart = np.abs(points[:, None] - points[None]).max(axis=2)
    different = parts[:, None] != parts[None]
    assert not (different & (apart <= gap)).any()
    order = list(range(len(points)))
    chance.shuffle(order)
    np.testing.assert_array_equal(stacking.parts_at_gaps(points[order], gap), parts[order])
    for part in range(parts.max() + 1):
        mine = np.sort(points[parts == part], axis=0)
        assert not (np.diff(mine, axis=0) > gap).any()


def test_slices_that_turn_against_each_other_are_no_volume():
    """One that differs is a group of its own; where all turn little by little, the sentence says how far.

    One slice at the border of what is the same is neither left out nor a reason to refuse the others.
    """
    straight, turn = np.array(TURNS["axial"]), np.array([0, 1, 0, -1, 0, 0])
    positions = positions_of(np.arange(100), straight)
    groups = grouped([picture(i, positions[i], straight + 0.003 * turn * (i == 3)) for i in range(7)])
    assert sorted(group.slices for group in groups) == [1, 6]
    most = np.array([-1, 1, 1, -1, 1, 1]) * 0.97e-3
    (group,) = grouped([picture(i, positions[i], straight + most * (i == 3), (0.5, 0.50048)) for i in range(7)])
    assert group.stack().kind == "even" and 0.5 < group.stack().moved < 1.5
    np.testing.assert_array_equal(group.stack().affine[:3, 0], [0.50048, 0.0, 0.0])
    (group,) = grouped([picture(i, positions[i], straight + 0.0005 * i * turn) for i in range(100)])
    with pytest.raises(stacking.Refused, match=r"corners are up to \d+\.\d\d mm off"):
        group.stack()
