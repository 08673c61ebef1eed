"""What kernels say plainly means what Python and numpy mean by the same words, and takes few of LLVM's."""

import numpy as np
import pytest

from rle_splat.runtime.jit import compiled, inner_loop, kernel

if not compiled():
    pytest.skip("nothing is compiled without numba", allow_module_level=True)

LAST = 2**63 - 1


def same(function, *arguments):
    """A function gives, compiled, what Python and numpy give: values, types, shapes and strides."""
    wanted, given = function(*arguments), kernel(function)(*arguments)
    for one, other in zip(wanted, given, strict=True):
        one, other = np.asarray(one), np.asarray(other)
        assert one.shape == other.shape and one.dtype.kind == other.dtype.kind
        assert one.strides == other.strides or one.size < 2
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("order", ("C", "F", "A"))
def test_elements_and_rows_from_either_end(order):
    volume = np.arange(4 * 5 * 6, dtype=np.int16).reshape(4, 5, 6)
    volume = {"C": volume, "F": np.asfortranarray(volume), "A": volume[::2, ::-1, 1:]}[order]

    def look(a, i, unsigned):
        return a[i, -1, 2], a[-2, i, i], a[unsigned, 0, 0], a[i], a[-1, i], a[i][1][-1], a[1, 2], a[0]

    same(look, volume, 1, np.uint32(1))


@pytest.mark.parametrize("begin, end", (
    (0, 3), (1, 4), (2, 2), (3, 1), (-3, -1), (-9, 2), (2, 99), (7, 9), (-LAST, LAST),
))  # fmt: skip
def test_slices_reach_no_further_than_the_array(begin, end):
    def cut(a, begin, end):
        return a[begin:end], a[begin:], a[:end], a[1, begin:end], a[begin:end, -1], a[-1, :], a[1:, begin:], a[:, 1:-1]

    same(cut, np.arange(20.0).reshape(4, 5), begin, end)
    same(cut, np.arange(40.0).reshape(8, 5)[::2], begin, end)


def test_slices_with_steps_are_still_numbas():
    def cut(a, step):
        return a[::2], a[1:9:step], a[::-1]

    same(cut, np.arange(10.0), 3)


def test_elements_are_written_where_they_belong():
    def write(i):
        grid, flags, words = np.zeros((3, 4)), np.zeros(5, np.bool_), np.zeros(3, np.uint8)
        grid[i, -1], grid[-1][0], grid[1] = 3, 2.5, 7.0
        flags[-2], flags[i] = i > 0, True
        words[i], words[0] = 300 - 45, i
        grid[0, 1:3] = 9.0
        grid[2, 1] += grid[i, 2] * grid[-1, 0]
        return grid, flags, words, flags[i], flags[0]

    same(write, 1)


@pytest.mark.parametrize("bounds", ((0, 5, 1), (3, -4, 1), (-4, 3, 2), (5, -5, -3), (2, 2, 1), (7, 0, -1)))
def test_ranges_give_each_number_once(bounds):
    def numbers(begin, end, step):
        out, at = np.zeros((4, 20), np.int64), 0
        for i in range(begin, end, step):
            out[0, at] = i
            at += 1
        for i in range(end):
            out[1, i] = i
        for at, i in enumerate(range(begin, end)):
            out[2, at] = i
            if i == end - 2:
                break
        last = 0
        for i in range(begin, end):
            for j in range(i):
                last += j
            if last > 20:
                continue
            out[3, i - begin] = last
        return (out, len(range(begin, end, step)))

    same(numbers, *bounds)


def test_a_range_without_a_step_is_refused():
    @kernel
    def steps(step):
        total = 0
        for i in range(0, 3, step):
            total += i
        return total

    with pytest.raises(ValueError, match="must not be zero"):
        steps(0)


@pytest.mark.parametrize("a, b", (
    (7, -3), (np.uint64(2**63), np.uint64(5)), (np.uint64(2**63), 5), (1.5, -0.0), (np.nan, 1.0), (3, 2.5),
    (np.float32(1.1), np.float32(3.3)), (np.float32(1.1), 2), (np.int32(-5), 3), (np.uint8(200), np.uint8(100)),
    (True, 2),
))  # fmt: skip
def test_numbers_of_any_kinds_are_compared_and_added_as_numba_does(a, b):
    from numba import njit

    def reckon(a, b):
        c = a
        c += b
        c *= b
        return a + b, a - b, a * b, a < b, a <= b, a > b, a >= b, a == b, a != b, c

    plain = njit(reckon)(a, b)
    for one, other in zip(plain, kernel(reckon, exact=True)(a, b), strict=True):
        assert type(one) is type(other) and np.array_equal(one, other, equal_nan=True)


def test_bits_of_whole_numbers():
    def mix(a, b):
        c = a
        c &= b
        c |= a << 3
        c ^= 5
        return a & b, a | b, a ^ b, a >> 2, a // 3, a % 5, c, (a > b) & (a != 3)

    same(mix, 0b1011010, 0b0110110)


def test_a_view_keeps_its_array_alive():
    @kernel
    def tail(count):
        scratch = np.empty(count)
        for i in range(count):
            scratch[i] = i
        return scratch[2:]

    views = [tail(50) for _ in range(20)]
    assert all(view.tolist() == list(range(2, 50)) for view in views)


def test_an_element_takes_a_handful_of_words():
    @inner_loop
    def body(values, shift, total):
        for i in range(values.size):
            total[0] += values[i + shift]

    @kernel
    def whole(values, shift, total):
        body(values, shift, total)

    whole(np.ones(3), 0, np.zeros(1))
    library = body.overloads[next(iter(body.overloads))].library
    type(library)._optimize_functions(library, library._final_module)  # which is left to what it is linked into
    words = library.get_llvm_str()
    assert "add nsw i64" in words  # what lets LLVM make a loop wide
    assert "srem" not in words and "sdiv" not in words and len(words.splitlines()) < 120
