"""Proves the truths themselves: closed forms G1 to G12 against plain quadrature, and T1 and T2 of the ray integrator
against closed forms and against tiny steps of programs that know neither cells nor pieces."""

import numpy as np
import pytest

from benchmarks.phantoms import blobs, marschner_lobb
from rle_splat.accuracy.integrate import integrate
from rle_splat.accuracy.light_model import LitField
from rle_splat.accuracy.medium import ClassifiedField, ScalarField, cubics, polynomial
from rle_splat.accuracy.rays import WorldRays, camera_rays
from rle_splat.accuracy.transfer import Segments, extinction_and_color
from rle_splat.accuracy.truths import truth, world_opacity_distance
from rle_splat.scene import RleSplatError
from tests.truths import closed_forms
from tests.truths.other_rays import turntable_rays

OBLIQUE = np.array(((0.9, 0.2, -0.1, 3.0), (-0.3, 1.1, 0.2, -2.0), (0.1, 0.0, 1.7, 1.0), (0.0, 0.0, 0.0, 1.0)))


class Points:
    """Transfer-function points without the renderer's own class."""

    def __init__(self, opacity, color=((0.0, 1.0, 0.5, 0.25),)):
        self.opacity, self.color = opacity, color


# Steps up and down, a plateau, a peak narrower than a voxel's change, alpha 1, and color points of its own.
HARD = Points(
    ((0.1, 0.0), (0.1, 0.3), (0.3, 0.3), (0.35, 0.0), (0.5, 0.0), (0.505, 0.8), (0.51, 0.0), (0.7, 0.0), (0.9, 1.0)),
    ((0.05, 0.9, 0.1, 0.1), (0.4, 0.1, 0.8, 0.3), (0.4, 0.3, 0.3, 0.3), (0.8, 0.2, 0.2, 1.0)),
)


def random_rays(count, seed=3, center=(4.5, 4.5, 4.5), spread=3.0):
    """Rays through the middle of a volume in all directions, depths not lengths; the first three along the axes."""
    random = np.random.default_rng(seed)
    through = np.asarray(center) + random.uniform(-spread, spread, (count, 3))
    direction = random.standard_normal((count, 3))
    direction[:3] = np.eye(3) * (1.0, -1.0, 1.0)
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    speed = random.uniform(1.0, 1.6, count)
    return WorldRays(through - direction * 30.0, direction, speed)


def stepped(fields, rays, near, far, steps):
    """(4,) rgba of one ray by equal steps: sources at their middles, seen through what lies before."""
    h = (far - near) / steps
    sampled = fields(rays.at_depth(0.0)[0] + rays.step[0] * (near + (np.arange(steps) + 0.5) * h)[:, None])
    sampled = sampled * h * rays.length_per_depth[0]
    tau = np.cumsum(sampled[:, 3])
    glow = (sampled[:, :3] * np.exp(0.5 * sampled[:, 3:] - tau[:, None])).sum(axis=0)
    return np.append(glow, -np.expm1(-tau[-1]))


def interpolated(values, positions):
    """Trilinear interpolation of (nz, ny, nx, ...) at (N, 3) positions x, y, z inside the grid, by its definition."""
    cell = np.clip(np.floor(positions).astype(int), 0, np.array(values.shape[2::-1]) - 2)
    part = positions - cell
    total = 0.0
    for corner in np.ndindex(2, 2, 2):
        weight = np.where(corner, part, 1.0 - part).prod(axis=1)
        x, y, z = (cell + corner).T
        total = total + values[z, y, x] * weight.reshape((-1,) + (1,) * (values.ndim - 3))
    return total


# --- closed forms ---


def test_lengths_in_boxes_and_ellipsoids():
    """G1, G2: counted along each line in twenty thousand steps."""
    rays = random_rays(40, center=(4.0, 0.0, 4.0))
    depth = np.linspace(0.0, 60.0, 20_001)
    ball = OBLIQUE @ np.array(((2.0, 0, 0, 1.0), (0, 3.0, 0, 2.0), (0, 0, 1.5, 2.0), (0, 0, 0, 1.0)))
    length = closed_forms.box_length(rays, OBLIQUE, (-1.0, 0.0, 0.5), (3.0, 4.0, 3.5))
    round_ = closed_forms.ellipsoid_length(rays, ball)
    for n in range(40):
        world = rays.origin[n] + rays.step[n] * depth[:, None]
        step = np.diff(depth)[0] * rays.length_per_depth[n]
        index, unit = ((world - m[:3, 3]) @ np.linalg.inv(m[:3, :3]).T for m in (OBLIQUE, ball))
        inside = ((index > (-1.0, 0.0, 0.5)) & (index < (3.0, 4.0, 3.5))).all(axis=1)
        assert abs(inside.sum() * step - length[n]) < 2.1 * step
        assert abs(((unit**2).sum(axis=1) < 1.0).sum() * step - round_[n]) < 2.1 * step
    assert (length > 1.0).sum() > 10 and (round_ > 1.0).sum() > 10
    sphere = np.diag((2.0, 2.0, 2.0, 1.0))
    sphere[:3, 3] = (2.0, 3.0, 4.0)
    np.testing.assert_allclose(
        closed_forms.ellipsoid_length(rays, sphere), closed_forms.sphere_length(rays, (2.0, 3.0, 4.0), 2.0), atol=1e-9
    )


def test_gaussian_and_slabs():
    """G3 to G6, each the limit of Simpson's rule on its own formula."""
    rays = random_rays(20)
    center, width = np.array((4.0, 5.0, 4.5)), 1.3

    def blob(world):
        sigma = 0.7 * np.exp(-0.5 * ((world - center) ** 2).sum(axis=-1) / width**2)
        return sigma[..., None] * np.array((0.2, 0.5, 1.0, 1.0))

    found = closed_forms.of_formula(blob, rays, 0.0, 60.0, 1e-11)
    expected = closed_forms.composed(closed_forms.gaussian_tau(rays, center, 0.7, width), (0.2, 0.5, 1.0))
    assert np.abs(found - expected).max() < 1e-10 and expected[:, 3].max() > 0.5
    slab = WorldRays(np.zeros((1, 3)), np.array(((0.0, 0.0, 1.0),)), np.ones(1))

    def graded(world):
        depth, sigma = world[..., 2], 0.45
        colors = (0.1 + 0.05 * depth, np.exp(-0.3 * depth), np.ones_like(depth))
        return np.stack([sigma * c for c in (*colors, np.ones_like(depth))], axis=-1)

    found = closed_forms.of_formula(graded, slab, 0.0, 7.0, 1e-12)[0]
    expected = (
        closed_forms.linear_source(0.45, 7.0, 0.1, 0.05), closed_forms.exponential_source(0.45, 7.0, 0.3),
        -np.expm1(-0.45 * 7.0), -np.expm1(-0.45 * 7.0),
    )  # fmt: skip
    np.testing.assert_allclose(found, expected, atol=1e-11)
    # G7: the slab is its two halves, one behind the other.
    parts = [closed_forms.of_formula(graded, slab, *ends, 1e-12) for ends in ((0.0, 3.0), (3.0, 7.0))]
    np.testing.assert_allclose(closed_forms.over(*parts)[0], expected, atol=1e-11)
    assert np.abs(closed_forms.over(*parts[::-1])[0] - expected).max() > 0.01


@pytest.mark.parametrize("degree", (0, 1, 2, 3))
def test_voxel_from_anywhere(degree):
    """G8: splines as boxes folded with boxes; a line through one against tiny steps, an axis view by its product."""
    t = np.arange(-3.0, 3.0, 1e-3)
    box = (np.abs(t) < 0.5).astype(float)
    folded = box
    for _ in range(degree):
        folded = np.convolve(folded, box, mode="same") * 1e-3
    assert np.abs(closed_forms.bspline(t, degree) - folded)[np.abs(np.abs(t) - 0.5) > 2e-3].max() < 5e-3
    rays = random_rays(30, spread=0.8)
    tau = closed_forms.voxel_tau(rays, np.eye(4), (4.5, 4.5, 4.5), 1.7, degree)
    depth = (np.arange(100_000) + 0.5) * (60.0 / 100_000)
    for n in range(30):
        offset = rays.origin[n] + rays.step[n] * depth[:, None] - 4.5
        near = (np.abs(offset) < 2.5).all(axis=1)
        counted = closed_forms.bspline(offset[near], degree).prod(axis=1).sum() * 1.7
        counted *= (60.0 / 100_000) * rays.length_per_depth[n]
        assert abs(tau[n] - counted) < (3e-3 if degree == 0 else 1e-6)
    assert (tau > 0.3).sum() > 10
    offset = (rays.origin - 4.5)[0]
    assert tau[0] == pytest.approx(closed_forms.impulse_tau(offset[1], offset[2], 1.7, 1.0, degree), abs=1e-12)


def test_integrator_meets_one_voxel_and_a_ramp():
    """G8 and G9 obliquely, in a sheared grid: T1 of one voxel is its tent's integral; a ramp is reproduced exactly,
    with its colors' light."""
    field = np.zeros((5, 5, 5))
    field[2, 3, 1] = 1.7
    rays = random_rays(60, center=(OBLIQUE @ (1.0, 3.0, 2.0, 1.0))[:3], spread=0.8)
    rgba, _ = integrate(ClassifiedField(field, np.ones((5, 5, 5, 3))), rays, OBLIQUE)
    tau = closed_forms.voxel_tau(rays, OBLIQUE, (1.0, 3.0, 2.0), 1.7)
    assert (tau > 0.3).sum() > 20
    assert np.abs(-np.log1p(-rgba[:, 3]) - tau).max() < 1e-11
    z, y, x = np.mgrid[0:8.0, 0:9.0, 0:10.0]
    constant, slope = 0.02, np.array((0.01, 0.005, 0.02))
    scalar = constant + slope[0] * x + slope[1] * y + slope[2] * z
    rays = random_rays(60, center=(OBLIQUE @ (4.5, 4.0, 3.5, 1.0))[:3])
    # The curve from scalar to extinction is bent; 1 - exp(-s) in many pieces is a line between them.
    values = np.linspace(0.0, 0.4, 4001)
    curve = Points(np.stack((values, -np.expm1(-values)), axis=1))
    rgba, _ = integrate(ScalarField(scalar, curve, 1.0), rays, OBLIQUE)
    tau = closed_forms.ramp_tau(rays, OBLIQUE, (0.0, 0.0, 0.0), (9.0, 8.0, 7.0), constant, slope)
    assert (tau > 0.3).sum() > 20
    assert np.abs(-np.log1p(-rgba[:, 3]) - tau).max() < 1e-7  # what the line between two points leaves, h^2 / 8


def test_radial_normals():
    """G10: normals are the gradients of any radial field."""
    points = np.random.default_rng(2).uniform(-3.0, 3.0, (50, 3))
    center, light, h = np.array((0.3, -0.2, 0.1)), np.array((0.6, 0.0, 0.8)), 1e-5
    normal, facing = closed_forms.radial_lambert(points, center, light)
    field = lambda p: -np.exp(-((p - center) ** 2).sum(axis=-1) / 9.0)  # noqa: E731
    gradient = np.stack([field(points + h * e) - field(points - h * e) for e in np.eye(3)], axis=-1)
    gradient /= np.linalg.norm(gradient, axis=1)[:, None]
    assert np.abs(normal - gradient).max() < 1e-6
    assert np.abs(facing - np.abs(gradient @ light)).max() < 1e-6
    assert not closed_forms.radial_lambert(center, center, light)[0].any()


class Samples:
    """Marschner and Lobb's signal on a grid of ``size`` samples a side, each computed when it is looked up."""

    def __init__(self, size):
        self.shape = (size,) * 3

    def __getitem__(self, indices):
        z, y, x = (2.0 * index / (self.shape[0] - 1) - 1.0 for index in np.broadcast_arrays(*indices))
        return marschner_lobb(np.stack((x, y, z), axis=-1))


def test_marschner_lobb_converges_to_its_formula():
    """G11: T2 of finer and finer samples tends to the integral of the formula itself, at second order."""
    colors = Points(((0.0, 0.0), (1.0, 0.9)), ((0.0, 0.1, 0.9, 0.2), (1.0, 0.8, 0.1, 0.5)))
    rays, _ = turntable_rays((2, 2, 2), (1.0, 1.0, 1.0), 30.0, 20.0, 0.3, False, 40.0, 6, 6)
    rays = WorldRays(rays.origin - 0.5, rays.direction, rays.length_per_depth)  # the middle of the cube is the origin

    def fields(world):
        sigma, color = extinction_and_color(colors, marschner_lobb(world), 0.7)
        return np.concatenate((color * sigma[..., None], sigma[..., None]), axis=-1)

    expected = closed_forms.of_formula(fields, rays, -0.7, 0.8)
    errors = []
    for size in (81, 161, 321):
        h = 2.0 / (size - 1)
        index_to_world = np.diag((h, h, h, 1.0))
        index_to_world[:3, 3] = -1.0
        medium = ScalarField(Samples(size), colors, 0.7, physical=np.asarray)
        found, _ = integrate(medium, rays, index_to_world, -0.7, 0.8)
        errors.append(np.abs(found - expected).max())
    assert expected[:, 3].min() > 0.5 and np.ptp(expected[:, 0]) > 0.005
    assert 3.4 < errors[1] / errors[2] < 4.6 and errors[2] < 1e-3, errors
    # By hand: on the axis the argument of the outer cosine is 12 pi.
    assert marschner_lobb((0.0, 0.0, -1.0)) == pytest.approx((2.0 + 0.25 * 2.0) / 2.5)
    assert marschner_lobb((1.0, 0.0, 1.0)) == pytest.approx(0.25 * 2.0 / 2.5)


@pytest.mark.parametrize("azimuth, elevation", ((0.0, 0.0), (35.0, 25.0), (-130.0, 70.0)))
def test_projection_slice(azimuth, elevation):
    """G12: the spectrum's X-ray, that of a Gaussian, and T1 of the ray integrator are the same picture."""
    n, width = 24, 2.2
    z, y, x = np.mgrid[0:n, 0:n, 0:n]
    field = 0.2 * np.exp(-0.5 * ((x - 12.0) ** 2 + (y - 10.5) ** 2 + (z - 11.0) ** 2) / width**2)
    a, e = np.radians(azimuth), np.radians(elevation)
    right = np.array((np.cos(a), np.sin(a), 0.0))
    forward = np.array((-np.sin(a) * np.cos(e), np.cos(a) * np.cos(e), -np.sin(e)))
    up = np.cross(right, forward)
    u, v = (11.5 * w.sum() + np.linspace(-8.0, 8.0, 9) for w in (right, up))
    picture = closed_forms.x_ray(field, right, up, u, v)
    through = (u[None, :, None] * right + v[:, None, None] * up).reshape(-1, 3)
    rays = WorldRays(through, np.broadcast_to(forward, through.shape), np.ones(len(through)))
    rgba, _ = integrate(ClassifiedField(field, np.ones((n, n, n, 3))), rays, np.eye(4))
    assert picture.max() > 0.8
    # Along an axis the kinks of all slices fall on the same line, and their spectrum is cut off.
    assert np.abs(picture.ravel() + np.log1p(-rgba[:, 3])).max() < (2e-4 if elevation else 6e-3)
    exact = closed_forms.gaussian_tau(rays, (12.0, 10.5, 11.0), 0.2, width)
    assert np.abs(picture.ravel() - exact).max() < 0.05  # the tent's own blur, width^-2 / 12 and more
    assert np.abs(picture.ravel() - exact).max() > 1e-3


def test_shepp_logan_by_counting():
    """G12: the sum of the ellipsoids is what is met along the line."""
    rays = random_rays(12, center=(0.0, 0.0, 0.0), spread=0.4)
    depth = np.linspace(10.0, 40.0, 30_001)
    for n, tau in enumerate(closed_forms.ellipsoids_tau(rays)):
        world = rays.origin[n] + rays.step[n] * depth[:, None]
        total = np.zeros(len(depth))
        for sigma, half_axes, center, degrees in closed_forms.SHEPP_LOGAN:
            c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
            off = (world - center) @ np.array(((c, -s, 0.0), (s, c, 0.0), (0.0, 0.0, 1.0)))
            total += sigma * (((off / half_axes) ** 2).sum(axis=1) < 1.0)
        assert abs(total.sum() * 1e-3 * rays.length_per_depth[n] - tau) < 5e-3
        assert tau > 0.1


# --- the ray integrator ---


def test_cubics_are_trilinear_interpolation_along_a_line():
    random = np.random.default_rng(4)
    corners, entry, travel = random.random((30, 8, 3)), random.random((30, 3)), random.standard_normal((30, 3))
    poly = cubics(corners, entry, travel)
    for t in (0.0, 0.3, 1.0, -0.7):
        found = polynomial(poly, np.array(t))
        for p in range(30):
            at = entry[p] + t * travel[p]
            expected = interpolated(corners[p].reshape(2, 2, 2, 3), at[None])[0]
            np.testing.assert_allclose(found[p], expected, atol=1e-12)


def test_segments_are_the_transfer_function():
    """Every value in its segment gives what the points say; opaque ranges are found, transparent ones left out."""
    segments = Segments(HARD)
    values = np.concatenate((np.random.default_rng(5).uniform(-0.5, 1.5, 2000), [p[0] for p in HARD.opacity]))
    alpha, color = segments.evaluate(segments.of(values), values[:, None])
    sigma, expected = extinction_and_color(HARD, values, 1.0)
    np.testing.assert_allclose(np.minimum(-np.log1p(-np.minimum(alpha[:, 0], 1.0 - 1e-16)), 16.635532333438686), sigma,
                               rtol=1e-9, atol=1e-12)  # fmt: skip
    seen = sigma > 0.0
    np.testing.assert_allclose(color[seen, :, 0], expected[seen], atol=1e-12)
    low = np.array((0.0, 0.0, 0.36, 0.36, 0.52, 0.95, np.nan))
    high = np.array((0.09, 0.1, 0.49, 0.501, 0.69, 2.0, 1.0))
    assert segments.show_between(low, high).tolist() == [False, True, False, True, False, True, False]


@pytest.mark.parametrize("matrix", (np.eye(4), OBLIQUE), ids=("unit", "sheared"))
def test_scalar_truth_against_tiny_steps(matrix):
    """T2 with steps, plateaus, a narrow peak and alpha 1; half of the rays end inside."""
    scalar = blobs((10, 10, 10), 4, count=5, width=(1.5, 3.0)).astype(np.float64)
    scalar = scalar / scalar.max() + 0.02 * np.random.default_rng(0).random((10, 10, 10))
    rays = random_rays(16, center=(matrix @ (4.5, 4.5, 4.5, 1.0))[:3], spread=2.0)
    far = np.where(np.arange(16) % 2, 60.0, 23.3)
    rgba, depth = integrate(ScalarField(scalar, HARD, 1.3), rays, matrix, far=far)
    inverse = np.linalg.inv(matrix)

    def fields(world):
        index = world @ inverse[:3, :3].T + inverse[:3, 3]
        inside = ((index >= 0.0) & (index <= 9.0)).all(axis=1)
        sigma, color = extinction_and_color(HARD, interpolated(scalar, np.clip(index, 0.0, 9.0)), 1.3)
        sigma = np.where(inside, sigma, 0.0)
        return np.concatenate((color * sigma[:, None], sigma[:, None]), axis=1)

    near, leaves = closed_forms.box_depths(rays, matrix, (0.0,) * 3, (9.0,) * 3)
    for n in np.flatnonzero(np.minimum(far, leaves) > near):
        expected = stepped(fields, rays[n : n + 1], near[n], min(far[n], leaves[n]), 50_000)
        assert np.abs(rgba[n] - expected).max() < 2e-4, n  # a step of the transfer function falls inside a step
    assert (rgba[:, 3] > 0.3).sum() > 8 and (depth < 1e9).any()


def test_truths_do_not_depend_on_the_tolerance():
    """Ten orders of tolerance between them, and the answers agree as they promise."""
    scalar = blobs((10, 10, 10), 4, count=5, width=(1.5, 3.0)).astype(np.float64) * 2.0
    rays = random_rays(200)
    sigma, color = extinction_and_color(HARD, scalar, 0.4)
    for medium in (ScalarField(scalar, HARD, 0.4), ClassifiedField(sigma, color)):
        best, _ = integrate(medium, rays, np.eye(4), tolerance=1e-13)
        for tolerance in (1e-10, 1e-7, 1e-4):
            found, _ = integrate(medium, rays, np.eye(4), tolerance=tolerance)
            assert np.abs(found - best).max() < 2.0 * tolerance
        assert best[:, 3].max() > 0.9


def test_shaded_post_classified_truth():
    """What voxels have of light is interpolated on its own, then evaluated at each point, against tiny steps."""
    random = np.random.default_rng(6)
    scalar = blobs((9, 9, 9), 2, count=4, width=(1.5, 3.0)).astype(np.float64)
    planes = random.random((9, 9, 9, 4))
    rising = Points(((0.05, 0.0), (0.3, 0.5), (0.5, 0.1)), ((0.0, 0.9, 0.1, 0.1), (0.4, 0.1, 0.8, 0.3)))
    rays = random_rays(10, center=(4.0, 4.0, 4.0), spread=2.0)

    class Light:
        """In place of a PostLight: (N, 3) light and highlight of positions x, y, z and of interpolated planes."""

        def planes(self, z, y, x):
            return planes[z, y, x]

        def at(self, index, found):
            return found[:, :1] ** 2 + 0.1 * index, found[:, 1:]

    medium = LitField(scalar, rising, 1.0, np.asarray, Light())
    rgba, _ = integrate(medium, rays, np.eye(4), tolerance=1e-10)

    def fields(index):
        inside = ((index >= 0.0) & (index <= 8.0)).all(axis=1)
        at = np.clip(index, 0.0, 8.0)
        sigma, color = extinction_and_color(rising, interpolated(scalar, at), 1.0)
        light, highlight = Light().at(at, interpolated(planes, at))
        color = color * light + highlight
        sigma = np.where(inside, sigma, 0.0)
        return np.concatenate((color * sigma[:, None], sigma[:, None]), axis=1)

    near, far = closed_forms.box_depths(rays, np.eye(4), (0.0,) * 3, (8.0,) * 3)
    for n in np.flatnonzero(far > near):
        assert np.abs(rgba[n] - stepped(fields, rays[n : n + 1], near[n], far[n], 50_000)).max() < 1e-8
    assert (rgba[:, 3] > 0.2).sum() > 4
    unlit, _ = integrate(ScalarField(scalar, rising, 1.0), rays, np.eye(4))
    np.testing.assert_allclose(rgba[:, 3], unlit[:, 3], atol=1e-9)


def test_values_that_are_no_numbers():
    """A cell with a NaN corner is transparent in T2, an infinite value is the transfer function's end."""
    ramp = Points(((0.0, 0.0), (8.0, 0.8)))
    scalar = np.broadcast_to(np.arange(9.0), (9, 9, 9)).copy()
    rays = WorldRays(np.array(((-5.0, 1.2, 1.3), (-5.0, 6.2, 6.3))), np.tile((1.0, 0.0, 0.0), (2, 1)), np.ones(2))
    whole, _ = integrate(ScalarField(scalar, ramp, 1.0), rays, np.eye(4))
    scalar[1, 1, 3] = np.nan
    scalar[:, :, 8] = np.inf
    found, _ = integrate(ScalarField(scalar, ramp, 1.0), rays, np.eye(4))
    tau = [-np.log1p(-0.1 * x) for x in np.linspace(2.0, 4.0, 200_001)]
    missing = np.mean(tau) * 2.0
    assert found[1] == pytest.approx(whole[1], abs=1e-12)
    assert np.log1p(-found[0, 3]) - np.log1p(-whole[0, 3]) == pytest.approx(missing, abs=1e-6)


def test_extinctions_without_measure():
    """A medium so dense that all is seen within a billionth of a voxel, and so thin that nothing is."""
    color = np.full((4, 4, 4, 3), (0.2, 0.5, 1.0))
    rays = WorldRays(np.array(((1.3, 1.4, -5.0),)), np.array(((0.0, 0.0, 1.0),)), np.ones(1))
    for sigma in (1e9, 1e22):
        rgba, depth = integrate(ClassifiedField(np.full((4, 4, 4), sigma), color), rays, np.eye(4))
        assert rgba[0] == pytest.approx((0.2, 0.5, 1.0, 1.0), abs=1e-9)
        assert depth[0] == pytest.approx(4.0 + np.sqrt(2.0 * np.log(2.0) / sigma), rel=1e-6)
    rgba, _ = integrate(ClassifiedField(np.full((4, 4, 4), 1e-30), color), rays, np.eye(4))
    assert rgba[0, 3] == pytest.approx(4e-30)
    # What is seen through e^-15 of the light still counts.
    rgba, _ = integrate(ClassifiedField(np.full((4, 4, 4), 5.0), color), rays, np.eye(4))
    assert rgba[0, 3] == pytest.approx(1.0 - np.exp(-20.0), abs=1e-13)


def test_an_unknown_truth_is_refused(stage):
    with pytest.raises(RleSplatError, match="There is no reference called 'T3'"):
        truth(stage.on_turntable(np.zeros((3, 3, 3))), "T3")


@pytest.mark.parametrize("which", ("T1", "T2"))
def test_a_scene_is_looked_up_where_rays_go(stage, which):
    """The lazy media of a scene are the media of whole arrays."""
    field = blobs((14, 12, 10), 7)
    scene = stage.on_turntable(field, perspective=True, size=(12, 10))
    rgba, depth = truth(scene, which)
    distance = world_opacity_distance(scene)
    values = scene.volume.physical(scene.volume.voxels)
    if which == "T1":
        medium = ClassifiedField(*extinction_and_color(scene.transfer_function, values, distance))
    else:
        medium = ScalarField(values, scene.transfer_function, distance)
    rays = camera_rays(scene.camera, scene.width, scene.height)
    expected = integrate(medium, rays, scene.index_to_world, scene.camera.clip_start, scene.camera.clip_end)
    assert rgba.max() > 0.3
    np.testing.assert_allclose(rgba, expected[0], atol=1e-14)
    np.testing.assert_allclose(depth, expected[1])
    inside = np.random.default_rng(1).uniform(0.5, 8.5, (50, 3))
    from_scene = medium.at(inside)
    sigma, _ = extinction_and_color(scene.transfer_function, interpolated(values, inside), distance)
    if which == "T2":
        np.testing.assert_allclose(from_scene[:, 3], sigma, atol=1e-12)
