"""The warp's filters: interpolation, reproduction, clamping."""

from functools import partial

import numpy as np
import pytest

from rle_splat.scene import WARP_FILTERS
from rle_splat.warp import reference
from rle_splat.warp.filters import FILTERS
from rle_splat.warp.reference import CLEAR, MARGIN
from rle_splat.warp.resample import resample, shown_in
from rle_splat.warp.spline_prefilter import spline_coefficients

PREFILTERS = [spline_coefficients, reference.find_coefficients]


def resample_window(pixels, half, sheet_origin, to_sheet, *others, threads=0):
    """The kernel, which looks only into a part of the picture."""
    *_, picture_origin, _, _, depth = others
    window = shown_in(np.linalg.inv(to_sheet), half.shape, sheet_origin, depth.shape, picture_origin)
    filled = np.empty((2, len(half)), np.int32)
    filled[0], filled[1] = 0, half.shape[1]
    resample(window, filled, 0, pixels, half, sheet_origin, to_sheet, *others, threads=threads)


RESAMPLERS = [resample_window, reference.resample]


def coefficients_of(prefilter, image, rows=None, columns=None):
    """Spline coefficients of an image of color and alpha, or of some of its rows and columns."""
    pixels = image.copy()
    pixels[..., 3] = 1 - pixels[..., 3]
    rows, columns = rows or slice(0, image.shape[0]), columns or slice(0, image.shape[1])
    coefficients = np.full_like(image[rows, columns], np.nan)
    prefilter(pixels, rows, columns, coefficients)
    return coefficients


def b_spline_at_nodes(coefficients):
    """The spline at its own inner nodes, from its definition: weights 1/6, 4/6, 1/6 along each axis."""
    for axis in (0, 1):
        along = np.moveaxis(coefficients.astype(np.float64), axis, 0)
        coefficients = np.moveaxis((along[:-2] + 4 * along[1:-1] + along[2:]) / 6, 0, axis)
    return coefficients


@pytest.mark.parametrize("prefilter", PREFILTERS)
@pytest.mark.parametrize("shape", [(3, 3), (3, 17), (40, 31), (37, 130)])
def test_the_cubic_interpolates(prefilter, shape):
    image = np.random.default_rng(3).random((*shape, 4)).astype(np.float32)
    found = b_spline_at_nodes(coefficients_of(prefilter, image))
    np.testing.assert_allclose(found, image[1:-1, 1:-1], atol=2e-6)


@pytest.mark.parametrize("prefilter", PREFILTERS)
def test_coefficients_are_the_pole_to_the_power_of_the_distance(prefilter):
    """The impulse response of 6 / (z + 4 + 1/z) is sqrt(3) (sqrt(3) - 2) ** |k|; cut off, to less than rounding."""
    image = np.zeros((71, 71, 4), np.float32)
    image[35, 35] = 1
    coefficients = coefficients_of(prefilter, image)
    response = np.sqrt(3.0) * (np.sqrt(3.0) - 2.0) ** np.abs(np.arange(-35, 36))
    np.testing.assert_allclose(coefficients[..., 1], np.outer(response, response), atol=1e-7)
    assert np.count_nonzero(coefficients[..., 3]) == (2 * MARGIN + 1) ** 2
    assert coefficients[35 - MARGIN, 35 + MARGIN, 3] != 0


@pytest.mark.parametrize("prefilter", PREFILTERS)
def test_a_window_has_the_coefficients_of_the_whole(prefilter):
    rng = np.random.default_rng(12)
    image = rng.random((90, 120, 4)).astype(np.float32)
    whole = coefficients_of(prefilter, image)
    for _ in range(40):
        top, left = rng.integers(0, 90 - 2 * MARGIN), rng.integers(0, 120 - 2 * MARGIN)
        bottom, right = rng.integers(top + 2 * MARGIN + 1, 91), rng.integers(left + 2 * MARGIN + 1, 121)
        window = coefficients_of(prefilter, image, slice(int(top), int(bottom)), slice(int(left), int(right)))
        # Samples are missing beyond a side of the window, unless it is a side of the image.
        inside = tuple(
            slice(MARGIN * (first > 0), last - first - MARGIN * (last < count))
            for first, last, count in ((top, bottom, 90), (left, right, 120))
        )
        np.testing.assert_array_equal(
            window[inside].view(np.uint32), whole[top:bottom, left:right][inside].view(np.uint32)
        )


def run(function, image, to_sheet, name, size, half=None, most=1.0, sheet_origin=(0, 0), picture_origin=(0, 0)):
    """``image``: color and alpha, or what the filter weighs instead."""
    rgba = np.full((*size, 4), np.nan, np.float32)
    depth = np.full(size, np.nan, np.float32)
    pixels = np.ascontiguousarray(image, dtype=np.float32)
    if not FILTERS[name].is_prefiltered:
        pixels = pixels * np.float32((1, 1, 1, -1)) + np.float32((0, 0, 0, 1))
    half = np.full(pixels.shape[:2], np.inf, np.float32) if half is None else half
    depth_map = np.array([[0.0, 0.0, 2.0], [0.0, 0.0, 0.5]])
    function(
        pixels, half, sheet_origin, to_sheet, np.zeros((3, 3)), 2, 1, *FILTERS[name][1:], np.float32(most),
        depth_map, picture_origin, True, rgba, depth,
    )  # fmt: skip
    return rgba, depth


def filtered(function, image, to_sheet, name, size, **options):
    """An image of color and alpha through a filter, prefiltered where that belongs to it."""
    prefilter = PREFILTERS[RESAMPLERS.index(function)]
    weighed = coefficients_of(prefilter, image.astype(np.float32)) if FILTERS[name].is_prefiltered else image
    return run(function, weighed, to_sheet, name, size, **options)[0]


SHIFT = np.array([[0.7, 0.1, 4.3], [-0.1, 0.8, 5.6], [0.0, 0.0, 1.0]])


@pytest.mark.parametrize("function", RESAMPLERS)
@pytest.mark.parametrize("name", WARP_FILTERS)
def test_a_ramp_is_reproduced(function, name):
    v, u = np.mgrid[0:40, 0:50].astype(np.float64)
    ramp = 0.2 + 0.005 * u + 0.004 * v
    pixels = np.stack((ramp * 0.5, ramp * 0.25, ramp, ramp), axis=-1).astype(np.float32)
    rgba, _ = run(function, pixels, SHIFT, name, (20, 30))  # a ramp is its own spline coefficients
    row, column = np.mgrid[0:20, 0:30] + 0.5
    expected = 0.2 + 0.005 * (0.7 * column + 0.1 * row + 4.3) + 0.004 * (-0.1 * column + 0.8 * row + 5.6)
    np.testing.assert_allclose(rgba[..., 3], expected, atol=1e-6)
    np.testing.assert_allclose(rgba[..., 0], 0.5 * expected, atol=1e-6)


@pytest.mark.parametrize("function", RESAMPLERS)
@pytest.mark.parametrize(("name", "power"), [("keys", 2), ("cubic", 3)])
def test_polynomials_are_reproduced(function, name, power):
    """Up to the order of the filter less one; away from the border, where the samples end."""
    v, u = np.mgrid[0:50, 0:60].astype(np.float64)

    def surface(u, v):
        return 0.2 + 0.5 * (u / 60.0) ** power + 0.2 * (v / 50.0) ** power - 0.1 * (u / 60.0) * (v / 50.0)

    image = np.repeat(surface(u, v)[..., None], 4, axis=-1)
    to_sheet = np.array([[0.7, 0.1, 18.3], [-0.1, 0.8, 19.6], [0.0, 0.0, 1.0]])
    rgba = filtered(function, image, to_sheet, name, (14, 26))
    row, column = np.mgrid[0:14, 0:26] + 0.5
    expected = surface(0.7 * column + 0.1 * row + 18.3, -0.1 * column + 0.8 * row + 19.6)
    np.testing.assert_allclose(rgba[..., 3], expected, atol=1e-6)
    linear = filtered(function, image, to_sheet, "bilinear", (14, 26))
    assert np.abs(linear[..., 3] - expected).max() > 2e-5


@pytest.mark.parametrize("function", RESAMPLERS)
@pytest.mark.parametrize(("name", "order"), [("bilinear", 2), ("keys", 3), ("cubic", 4)])
def test_order_of_convergence(function, name, order):
    """The error on a smooth image falls by 2 ** order where it is sampled twice as finely."""
    errors = []
    for count in (24, 48):
        v, u = np.mgrid[-20 : count + 20, -20 : count + 20] / count

        def surface(u, v):
            return 0.5 + 0.2 * np.sin(7.0 * u + 1.0) + 0.2 * np.cos(6.0 * v - u)

        image = np.repeat(surface(u, v)[..., None], 4, axis=-1)
        size = 96
        to_sheet = np.array([[count / size, 0, 20.0], [0, count / size, 20.0], [0, 0, 1]])
        rgba = filtered(function, image, to_sheet, name, (size, size))
        row, column = (np.mgrid[0:size, 0:size] + 0.5) / size
        errors.append(np.abs(rgba[..., 3] - surface(column, row)).max())
    assert order - 0.3 < np.log2(errors[0] / errors[1]) < order + 0.4


@pytest.mark.parametrize("function", RESAMPLERS)
@pytest.mark.parametrize("name", ["keys", "cubic"])
def test_lobes_are_clamped_to_the_premultiplied_range(function, name):
    image = np.zeros((30, 30, 4), np.float32)
    image[:, 15:] = (0.8, 0.8, 0.8, 1.0)
    close = np.array([[0.3, 0, 10.0], [0, 0.3, 5.0], [0, 0, 1]])
    rgba = filtered(function, image, close, name, (30, 30), most=0.8)
    assert rgba[..., 3].min() == 0 and rgba[..., 3].max() == 1  # both lobes are cut off
    assert (rgba[..., :3] >= 0).all() and (rgba[..., :3] <= 0.8 * rgba[..., 3:] + 1e-7).all()


@pytest.mark.parametrize("function", RESAMPLERS)
@pytest.mark.parametrize("name", WARP_FILTERS)
def test_nothing_stays_nothing(function, name):
    rgba = filtered(function, np.zeros((30, 40, 4)), SHIFT, name, (20, 30))
    assert (rgba.view(np.uint32) == 0).all()


@pytest.mark.parametrize("function", RESAMPLERS)
def test_depth_is_not_interpolated_across_an_edge(function):
    pixels = np.zeros((30, 30, 4), np.float32)
    half = np.full((30, 30), 4.0, np.float32)
    half[:, 15:] = 24.0
    _, depth = run(function, pixels, np.array([[0.5, 0, 6.0], [0, 0.5, 6.0], [0, 0, 1]]), "bilinear", (30, 30), half)
    found = depth[depth < 1e9]
    assert len(found) and set(np.round(found, 4)) == {4.0, 14.0}  # 2 + 0.5 * half


def test_kernels_agree_with_their_references():
    rng = np.random.default_rng(9)
    pixels = rng.random((33, 44, 4)).astype(np.float32)
    half = rng.choice([3.0, 3.5, 40.0, np.inf], size=(33, 44)).astype(np.float32)
    no_ties = SHIFT + np.array([[0, 0, 0.01237], [0, 0, 0.02113], [0, 0, 0]])  # nearest pixels must be clear-cut
    for name in WARP_FILTERS:
        one, two = (run(function, pixels, no_ties, name, (30, 40), half) for function in RESAMPLERS)
        np.testing.assert_allclose(one[0], two[0], atol=2e-6)
        np.testing.assert_allclose(one[1], two[1], rtol=1e-6)


@pytest.mark.parametrize("to_sheet", [
    np.array([[0.9, 0.4, -31.0], [-0.4, 0.9, 7.0], [0.0, 0.0, 1.0]]),
    np.array([[0.9, 0.4, -31.0], [-0.4, 0.9, 7.0], [4e-3, -2e-3, 1.0]]),
    np.linalg.inv(np.array([[1.0, 0.0, 20.0137], [0.0, 1.0, 20.0211], [-0.04, 0.0, 1.0]])),  # a horizon across
    np.array([[0.9, 0.4, -500.0], [-0.4, 0.9, 7.0], [0.0, 0.0, 1.0]]),  # beside the picture
])  # fmt: skip
def test_every_pixel_that_looks_into_a_sheet_is_found(to_sheet):
    """The kernel looks only in a part of the picture, the reference everywhere; what sees nothing is left as it was."""
    pixels = np.random.default_rng(21).random((33, 44, 4)).astype(np.float32)
    half = np.full((33, 44), 5.0, np.float32)
    found = []
    for function in RESAMPLERS:
        rgba, depth = np.full((90, 110, 4), 7.0, np.float32), np.full((90, 110), 7.0, np.float32)
        function(
            pixels, half, (0, 0), to_sheet, np.zeros((3, 3)), 2, 1, 2, FILTERS["bilinear"].table, np.float32(1.0),
            np.array([[0.0, 0.0, 2.0], [0.0, 0.0, 0.5]]), (0, 0), False, rgba, depth,
        )  # fmt: skip
        found.append((rgba, depth))
    np.testing.assert_allclose(found[0][0], found[1][0], atol=2e-6)
    np.testing.assert_allclose(found[0][1], found[1][1], rtol=1e-6)
    seen = (found[1][1] != 7.0).mean()
    assert seen == 0.0 if to_sheet[0, 2] < -100.0 else 0.05 < seen < 0.95


@pytest.mark.parametrize("function", RESAMPLERS)
@pytest.mark.parametrize("name", WARP_FILTERS)
def test_a_window_of_a_picture_is_the_same_to_the_bit(function, name):
    """Windows of sheet and picture, by the numbers of their first pixels, in the sheet's and the picture's own."""
    rng = np.random.default_rng(4)
    pixels = rng.random((60, 70, 4)).astype(np.float32)
    half = rng.choice([3.0, 3.5, 40.0, np.inf], size=(60, 70)).astype(np.float32)
    tilted = np.array([[0.71, 0.13, 4.3], [-0.11, 0.83, 5.6], [1e-3, -2e-3, 1.0]])
    rgba, depth = run(function, pixels, tilted, name, (60, 70), half)
    assert (depth < 1e9).mean() > 0.3
    for top, left, bottom, right in ((20, 17, 40, 44), (31, 3, 52, 18), (0, 0, 9, 70)):
        row, column = np.mgrid[top:bottom, left:right] + 0.5
        u, v, w = np.tensordot(tilted, (column, row, np.ones_like(row)), axes=1)
        u, v = u / w, v / w
        first_u, first_v = (int(max(position.min() - 3, 0)) for position in (u, v))
        part = np.s_[first_v : int(v.max()) + 5, first_u : int(u.max()) + 5]
        found = run(
            function, pixels[part], tilted, name, (bottom - top, right - left), np.ascontiguousarray(half[part]),
            sheet_origin=(first_u, first_v), picture_origin=(left, top),
        )  # fmt: skip
        np.testing.assert_array_equal(found[0].view(np.uint32), rgba[top:bottom, left:right].view(np.uint32))
        np.testing.assert_array_equal(found[1].view(np.uint32), depth[top:bottom, left:right].view(np.uint32))


@pytest.mark.parametrize("name", WARP_FILTERS)
def test_any_number_of_threads_gives_the_same_bits(name):
    image = np.random.default_rng(5).random((90, 80, 4)).astype(np.float32)
    pictures = []
    for threads in (1, 2, 0):
        prefilter, function = (partial(f, threads=threads) for f in (spline_coefficients, resample_window))
        weighed = coefficients_of(prefilter, image) if FILTERS[name].is_prefiltered else image
        pictures.append(run(function, weighed, SHIFT, name, (100, 90))[0].tobytes())
    assert pictures[0] == pictures[1] == pictures[2]


def test_every_filter_of_the_table_is_there():
    assert tuple(FILTERS) == WARP_FILTERS


@pytest.mark.parametrize("function", RESAMPLERS)
def test_nothing_is_shown_between_four_transparent_pixels(function):
    """The cubic's lobes beside a hard outline; what is seen of a pixel stays as it is."""
    image = np.zeros((40, 40, 4))
    image[:, 20:] = 0.5, 0.6, 0.7, 1.0
    to_sheet = np.array([[0.3, 0.0, 14.0], [0.0, 0.3, 14.0], [0.0, 0.0, 1.0]])
    half = np.full((40, 40), np.inf, np.float32)
    with_lobes = filtered(function, image, to_sheet, "cubic", (12, 30), half=half)
    half[:, :20], half[:, 20:] = CLEAR, 3.0
    found = filtered(function, image, to_sheet, "cubic", (12, 30), half=half)
    beside = 14.0 + 0.3 * (np.arange(30) + 0.5) < 19.0
    assert with_lobes[:, beside].max() > 0.01 and not found[:, beside].any()
    assert np.array_equal(found[:, ~beside], with_lobes[:, ~beside]) and found[:, ~beside].max() > 0.5
