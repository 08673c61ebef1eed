"""Pictures known on paper (algorithm.md 2.3, G1 to G12): optical depths and colors of simple bodies along world
rays.  Lengths are world lengths, extinctions are per world length, colors are unassociated; nothing here samples a
grid but ``x_ray``, which sums its spectrum.
"""

from __future__ import annotations

import numpy as np

from rle_splat.accuracy.rays import WorldRays

# The head phantom of Shepp and Logan in three dimensions, in a cube from -1 to 1: extinction, half axes along x, y,
# z, center, and degrees by which it is turned about z.  The insides add up: the brain is 1.0 - 0.8.
SHEPP_LOGAN = (
    (1.0, (0.69, 0.92, 0.81), (0.0, 0.0, 0.0), 0.0),
    (-0.8, (0.6624, 0.874, 0.78), (0.0, -0.0184, 0.0), 0.0),
    (-0.2, (0.11, 0.31, 0.22), (0.22, 0.0, 0.0), -18.0),
    (-0.2, (0.16, 0.41, 0.28), (-0.22, 0.0, 0.0), 18.0),
    (0.1, (0.21, 0.25, 0.41), (0.0, 0.35, -0.15), 0.0),
    (0.1, (0.046, 0.046, 0.05), (0.0, 0.1, 0.25), 0.0),
    (0.1, (0.046, 0.046, 0.05), (0.0, -0.1, 0.25), 0.0),
    (0.1, (0.046, 0.023, 0.05), (-0.08, -0.605, 0.0), 0.0),
    (0.1, (0.023, 0.023, 0.02), (0.0, -0.606, 0.0), 0.0),
    (0.1, (0.023, 0.046, 0.02), (0.06, -0.605, 0.0), 0.0),
)


def composed(tau, color) -> np.ndarray:
    """G4: (N,) optical depths of a medium of one color -> (N, 4) premultiplied; the order inside never matters."""
    alpha = -np.expm1(-np.asarray(tau, dtype=np.float64))[:, None]
    return np.concatenate((alpha * np.asarray(color, dtype=np.float64), alpha), axis=1)


def over(front, back) -> np.ndarray:
    """G7: (N, 4) premultiplied bodies, one wholly before the other: a1 c1 + (1 - a1) a2 c2."""
    return front + (1.0 - front[:, 3:]) * back


def _lines(rays: WorldRays, matrix) -> tuple[np.ndarray, np.ndarray]:
    """Rays in the space that ``matrix`` takes to the world: (N, 3) starts, and (N, 3) steps per planar depth."""
    inverse = np.linalg.inv(matrix)
    return rays.origin @ inverse[:3, :3].T + inverse[:3, 3], rays.step @ inverse[:3, :3].T


def box_depths(rays: WorldRays, index_to_world, low, high) -> tuple[np.ndarray, np.ndarray]:
    """(N,) planar depths at which each ray's whole line enters and leaves an index-space box; it misses the box
    where the second is not above the first."""
    start, step = _lines(rays, index_to_world)
    with np.errstate(divide="ignore", invalid="ignore"):
        a, b = (np.asarray(low) - start) / step, (np.asarray(high) - start) / step
    inside = (start >= low) & (start <= high)
    enters = np.where(step == 0.0, np.where(inside, -np.inf, np.inf), np.minimum(a, b)).max(axis=1)
    leaves = np.where(step == 0.0, np.where(inside, np.inf, -np.inf), np.maximum(a, b)).min(axis=1)
    return enters, leaves


def box_length(rays: WorldRays, index_to_world, low, high) -> np.ndarray:
    """G1: (N,) world length inside an index-space box of each ray's whole line."""
    enters, leaves = box_depths(rays, index_to_world, low, high)
    return np.maximum(leaves - enters, 0.0) * rays.length_per_depth


def distance_to_axis(rays: WorldRays, center) -> np.ndarray:
    """b: (N,) world distance between a point and the line of each ray."""
    to_center = np.asarray(center, dtype=np.float64) - rays.origin
    along = (to_center * rays.direction).sum(axis=1)
    return np.sqrt(np.maximum((to_center**2).sum(axis=1) - along**2, 0.0))


def sphere_length(rays: WorldRays, center, radius: float) -> np.ndarray:
    """G2: (N,) world length of each ray inside a sphere, 2 sqrt(R^2 - b^2)."""
    return 2.0 * np.sqrt(np.maximum(radius**2 - distance_to_axis(rays, center) ** 2, 0.0))


def ellipsoid_length(rays: WorldRays, ball_to_world) -> np.ndarray:
    """G2: (N,) world length of each ray inside the image of the unit ball under a 4x4 matrix."""
    start, step = _lines(rays, ball_to_world)
    square, middle = (step**2).sum(axis=1), (start * step).sum(axis=1)
    inside = middle**2 - square * ((start**2).sum(axis=1) - 1.0)
    return 2.0 * np.sqrt(np.maximum(inside, 0.0)) / square * rays.length_per_depth


def ellipsoids_tau(rays: WorldRays, ellipsoids=SHEPP_LOGAN) -> np.ndarray:
    """G12: (N,) optical depth of overlapping ellipsoids whose extinctions add, rows as in SHEPP_LOGAN."""
    tau = np.zeros(len(rays.origin))
    for sigma, half_axes, center, degrees in ellipsoids:
        c, s = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
        matrix = np.eye(4)
        matrix[:3, :3] = np.array(((c, -s, 0.0), (s, c, 0.0), (0.0, 0.0, 1.0))) * half_axes
        matrix[:3, 3] = center
        tau += sigma * ellipsoid_length(rays, matrix)
    return tau


def gaussian_tau(rays: WorldRays, center, peak: float, width: float) -> np.ndarray:
    """G3: (N,) optical depth of peak * exp(-r^2 / 2 width^2), in world lengths: peak width sqrt(2 pi) exp(-b^2/..)."""
    b = distance_to_axis(rays, center)
    return peak * width * np.sqrt(2.0 * np.pi) * np.exp(-0.5 * (b / width) ** 2)


def linear_source(sigma: float, length, start: float, slope: float) -> np.ndarray:
    """G5: radiance of a slab of constant extinction whose color is start + slope * depth."""
    seen = np.exp(-sigma * np.asarray(length, dtype=np.float64))
    return start * (1.0 - seen) + slope / sigma * (1.0 - seen * (1.0 + sigma * np.asarray(length)))


def exponential_source(sigma: float, length, rate: float) -> np.ndarray:
    """G6: radiance of a slab of constant extinction whose color is exp(-rate * depth)."""
    return -sigma / (sigma + rate) * np.expm1(-(sigma + rate) * np.asarray(length, dtype=np.float64))


def bspline(u, degree: int = 1) -> np.ndarray:
    """The cardinal B-spline, support (degree + 1) / 2 to either side: a box (0) folded with itself; 1 is the tent."""
    u = np.asarray(u, dtype=np.float64)
    if degree == 0:
        return ((u >= -0.5) & (u < 0.5)).astype(np.float64)
    reach = 0.5 * (degree + 1)
    return ((u + reach) * bspline(u + 0.5, degree - 1) + (reach - u) * bspline(u - 0.5, degree - 1)) / degree


def impulse_tau(u, v, sigma: float, slice_distance: float, degree: int = 1) -> np.ndarray:
    """G8: optical depth of one voxel seen along an axis, at index offsets u, v from its center."""
    return sigma * slice_distance * bspline(u, degree) * bspline(v, degree)


def voxel_tau(rays: WorldRays, index_to_world, voxel, sigma: float, degree: int = 1) -> np.ndarray:
    """G8, from anywhere: (N,) optical depth of one voxel at index (x, y, z), its B-spline the same along all axes.

    Between the spline's knots the product of the three is a polynomial of degree 3 * degree, which Gauss-Legendre
    quadrature integrates exactly.
    """
    start, step = _lines(rays, index_to_world)
    start = start - np.asarray(voxel, dtype=np.float64)
    knots = np.arange(degree + 2.0) - 0.5 * (degree + 1)
    with np.errstate(divide="ignore", invalid="ignore"):
        at = (knots - start[..., None]) / step[..., None]
    near, far = box_depths(WorldRays(start, step, np.ones(len(start))), np.eye(4), knots[[0] * 3], knots[[-1] * 3])
    far = np.maximum(near, far)  # no length where the voxel is missed
    missed = ~np.isfinite(near)
    near, far = np.where(missed, 0.0, near), np.where(missed, 0.0, far)
    at = np.where(np.isfinite(at), at, near[:, None, None]).reshape(len(start), -1)
    at = np.sort(np.clip(at, near[:, None], far[:, None]), axis=1)
    nodes, weights = np.polynomial.legendre.leggauss((3 * degree + 2) // 2)
    depth = at[:, :-1, None] + np.diff(at, axis=1)[..., None] * 0.5 * (nodes + 1.0)
    positions = start[:, None, None] + step[:, None, None] * depth[..., None]
    values = bspline(positions, degree).prod(axis=-1) @ (0.5 * weights)
    return sigma * (values * np.diff(at, axis=1)).sum(axis=1) * rays.length_per_depth


def ramp_tau(rays: WorldRays, index_to_world, low, high, constant: float, slope) -> np.ndarray:
    """G9: (N,) optical depth inside an index-space box of the extinction constant + slope . (x, y, z), which is to
    be above zero there: the length times the value half way."""
    enters, leaves = box_depths(rays, index_to_world, low, high)
    start, step = _lines(rays, index_to_world)
    missed = ~(leaves > enters)
    middle = np.where(missed, 0.0, 0.5 * (enters + leaves))
    value = constant + (start + step * middle[:, None]) @ np.asarray(slope, dtype=np.float64)
    return np.where(missed, 0.0, (leaves - enters) * rays.length_per_depth * value)


def radial_lambert(points, center, to_light) -> tuple[np.ndarray, np.ndarray]:
    """G10: of any field of the distance from ``center``: unit normals (..., 3) at ``points``, and |n . l| (...) of a
    unit vector ``to_light``; where there is no normal, at the center, both are zero."""
    outward = np.asarray(points, dtype=np.float64) - center
    length = np.sqrt((outward**2).sum(axis=-1, keepdims=True))
    normal = np.divide(outward, length, out=np.zeros_like(outward), where=length > 0.0)
    return normal, np.abs(normal @ np.asarray(to_light, dtype=np.float64))


def of_formula(fields, rays: WorldRays, near, far, tolerance: float = 1e-8) -> np.ndarray:
    """G11: premultiplied rgba (N, 4) of a medium given by a formula: ``fields`` takes (..., 3) world points to
    (..., 4) extinction * RGB and extinction, smooth between ``near`` and ``far``, planar depths, scalars or (N,).

    Simpson's rule on 32, 64, ... intervals a ray, until doubling changes no channel by more than ``tolerance``.
    """
    near, far = (np.broadcast_to(np.asarray(d, dtype=np.float64), len(rays.origin)) for d in (near, far))
    best = np.full((len(near), 4), np.inf)
    for level in range(5, 15):
        share = np.linspace(0.0, 1.0, 2 * 2**level + 1)
        depth = near[:, None] + share * (far - near)[:, None]
        world = rays.origin[:, None] + rays.step[:, None] * depth[..., None]
        length = (far - near) * rays.length_per_depth / 2**level
        sampled = fields(world) * length[:, None, None]
        found = _simpson(sampled[:, :-2:2], sampled[:, 1::2], sampled[:, 2::2])
        if np.abs(found - best).max() <= tolerance:
            return found
        best = found
    return best


def _simpson(first, middle, last) -> np.ndarray:
    """rgba (N, 4) of intervals whose fields, times their lengths, are (N, intervals, 4) at both ends and half way."""
    tau = (first[..., 3] + 4.0 * middle[..., 3] + last[..., 3]) / 6.0
    reached = np.cumsum(tau, axis=1)
    before = reached - tau
    half_way = before + (5.0 * first[..., 3] + 8.0 * middle[..., 3] - last[..., 3]) / 24.0
    seen = [np.exp(-depth)[..., None] for depth in (before, half_way, reached)]
    glow = (seen[0] * first[..., :3] + 4.0 * seen[1] * middle[..., :3] + seen[2] * last[..., :3]).sum(axis=1) / 6.0
    return np.concatenate((glow, -np.expm1(-reached[:, -1:])), axis=1)


def x_ray(extinction, right, up, u, v, bands: float = 2.0) -> np.ndarray:
    """G12: optical depth of parallel rays through trilinear samples, by the projection-slice theorem.

    ``extinction``: (nz, ny, nx), zero outside.  ``right``, ``up``: orthonormal vectors (x, y, z) across the rays;
    a ray meets the plane through voxel (0, 0, 0) at u * right + v * up; all in voxels, which are cubes.
    Returns (len(v), len(u)).  The transform of the picture is a plane of the medium's, which is that of the samples
    times that of the tent, sinc^2 along each axis.  Frequencies above ``bands`` / 2 cycles a voxel are cut off, so
    the samples have to be smooth.
    """
    extinction = np.asarray(extinction, dtype=np.float64)
    period = 2.0 * np.linalg.norm(np.array(extinction.shape) + 1.0)  # the projection, wherever it lies, fits twice
    most = int(np.ceil(0.5 * bands * period))
    across = np.arange(-most, most + 1) / period
    a, b = (g.ravel()[:, None] for g in np.meshgrid(across, across))
    k = a * np.asarray(right, dtype=np.float64) + b * np.asarray(up, dtype=np.float64)
    waves = [np.exp(-2j * np.pi * k[:, axis, None] * np.arange(n)) for axis, n in enumerate(extinction.shape[::-1])]
    total = np.zeros(len(k), dtype=np.complex128)
    for z, plane in enumerate(extinction):
        total += waves[2][:, z] * ((waves[1] @ plane) * waves[0]).sum(axis=1)
    spectrum = (total * (np.sinc(k) ** 2).prod(axis=1)).reshape(len(across), len(across)) / period**2
    to_v, to_u = (np.exp(2j * np.pi * np.multiply.outer(at, across)) for at in (v, u))
    return (to_v @ spectrum @ to_u.T).real
