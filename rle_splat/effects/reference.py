"""The kernels of this folder once more in numpy, to be read, to run where numba is missing, and to test against.

Depths of meshes and their silhouettes, and glass (algorithm.md 4.2).
"""

import numpy as np

# Samples this close outside an edge, in parts of the triangle, still count: neighbors must leave no crack.
CRACK = 1e-9
REACH = 4  # pixels past a silhouette that the warp's filter may read
SIDES = ((0, 1), (0, -1), (1, 0), (-1, 0))  # rows down, columns right


def rasterize(edges, depths, bounds, nearest, furthest, sample_columns, sample_rows, left, above, out):
    """Depths of the first surface at each sample, as ``mesh_depth.rasterize``: one triangle at a time."""
    height, width = out.shape[:2]
    for t in range(len(edges)):
        first = np.maximum(np.floor(bounds[t, :2]), (left, above))
        last = np.minimum(np.floor(bounds[t, 2:]) + 1.0, (left + width, above + height))
        if (first >= last).any():
            continue
        (c0, r0), (c1, r1) = first.astype(int), last.astype(int)
        x = np.arange(c0, c1)[None, :, None] + sample_columns
        y = np.arange(r0, r1)[:, None, None] + sample_rows
        a, b, c = (e[0] * x + e[1] * y + e[2] for e in edges[t])
        total = a + b + c
        slack = -CRACK * total
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = (a * depths[t, 0] + b * depths[t, 1] + c * depths[t, 2]) / total
        met = (total > 0.0) & (a >= slack) & (b >= slack) & (c >= slack) & (depth >= nearest) & (depth <= furthest)
        part = out[r0 - above : r1 - above, c0 - left : c1 - left]
        np.copyto(part, np.where(met, np.minimum(part, depth), part), casting="same_kind")


def pass_through(edges, depths, bounds, shares, nearest, ends, sample_columns, sample_rows, corner, rgba) -> None:
    """Pixels (H, W, 4) seen through panes, as ``glass.pass_through``: one pane at a time."""
    height, width = ends.shape
    x = corner[0] + np.arange(width)[None, :, None] + sample_columns
    y = corner[1] + np.arange(height)[:, None, None] + sample_rows
    passed = np.ones((height, width, len(sample_columns), 4), np.float32)
    for t in range(len(edges)):
        a, b, c = (e[0] * x + e[1] * y + e[2] for e in edges[t])
        total = a + b + c
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = (a * depths[t, 0] + b * depths[t, 1] + c * depths[t, 2]) / total
        met = (total > 0.0) & (a >= 0.0) & (b >= 0.0) & (c >= 0.0) & (depth >= nearest) & (depth < ends[..., None])
        passed[met] *= shares[t]
    rgba *= passed.mean(axis=2)


def find_layers(samples, step: float, layers, spread) -> None:
    """Near and far depth and coverage (H, W) of the surfaces at each pixel, as ``depth_layers.find_layers``."""
    _find_surfaces(samples, step, layers, spread)
    known = (layers[2] < 1.0) | _find_silhouettes(*layers, spread, step)
    _carry_past_silhouettes(*layers, known)


def _find_surfaces(samples, step: float, layers, spread) -> None:
    """Those of ``depth_layers._surfaces``: near, far and coverage of each pixel by itself, and the spread of the
    samples of its surface, infinite where it has two."""
    near, far, coverage = layers
    count = samples.shape[-1]
    samples = samples.astype(np.float32)
    least, most = samples.min(axis=-1), samples.max(axis=-1)
    with np.errstate(invalid="ignore"):
        spread[:] = np.where(np.isinf(least), 0.0, most - least)  # inf - inf is nan: no mesh at all
    split = spread > np.float32(step)
    near[:] = np.where(np.isinf(most), most, samples.mean(axis=-1, dtype=np.float64))
    far[:], coverage[:] = near, 1.0
    if not split.any():
        return
    # Few pixels hold two surfaces; only those are sorted, and cut at their widest gap.
    ordered = np.sort(samples[split].astype(np.float64), axis=-1)
    with np.errstate(invalid="ignore"):
        gaps = np.nan_to_num(np.diff(ordered, axis=-1), nan=0.0, posinf=np.inf)
    in_front = gaps.argmax(axis=-1) + 1
    is_near = np.arange(count) < in_front[:, None]
    near[split] = np.where(is_near, ordered, 0.0).sum(axis=-1) / in_front
    far[split] = np.where(is_near, 0.0, ordered).sum(axis=-1) / (count - in_front)
    coverage[split], spread[split] = in_front / count, np.inf


def _find_silhouettes(near, far, coverage, spread, step: float) -> np.ndarray:
    """Give both depths to two pixels between which a silhouette runs exactly; returns which pixels got them.

    A steep surface is no silhouette: its neighbors are no further apart than it falls within a pixel.  A pixel between
    a nearer and a further one, as of a line that is steep, keeps its own depth and takes the further one.
    """
    own, found = near.copy(), np.zeros(near.shape, dtype=bool)
    step, two = np.float32(step), np.float32(2.0)
    for to, of in _neighbors(near.shape):
        with np.errstate(invalid="ignore"):
            behind = own[to] - own[of] > step + two * (spread[to] + spread[of])
        near[to][behind], far[of][behind] = own[of][behind], own[to][behind]
        coverage[to][behind] = 0.0
        found[to] |= behind
        found[of] |= behind
    between = (coverage == 0.0) & (far != own)
    near[between], coverage[between] = own[between], 1.0
    return found


def _carry_past_silhouettes(near, far, coverage, known) -> None:
    """Give pixels near a silhouette both of its depths; the one that is not their own gets no weight.

    The carried depths end somewhere too, and there the filter reads across that end: pixels as far again keep to
    the layer that is their own surface all the way.
    """
    for number in range(2 * REACH if known.any() else 0):
        reached = known.copy()
        for to, of in _neighbors(near.shape):
            new = known[of] & ~reached[to]
            if not new.any():
                continue
            if number < REACH:
                own, near_there, far_there = near[to][new], near[of][new], far[of][new]
                with np.errstate(invalid="ignore"):
                    to_near, to_far = np.abs(own - near_there), np.abs(own - far_there)
                # inf - inf is nan: both see no mesh, the same surface.
                on_near = np.where(np.isnan(to_near), 0.0, to_near) <= np.where(np.isnan(to_far), 0.0, to_far)
                near[to][new] = np.where(on_near, own, near_there)
                far[to][new] = np.where(on_near, far_there, own)
                coverage[to][new] = np.where(on_near, 1.0, 0.0)
            else:
                coverage[to][new] = coverage[of][new]
            reached[to][new] = True
        known = reached


def _neighbors(shape):
    """Pairs of slices, ``to`` and ``of``: each pixel beside its neighbor on the left, right, top and bottom."""
    height, width = shape
    for down, right in SIDES:
        yield (
            (slice(max(down, 0), height + min(down, 0)), slice(max(right, 0), width + min(right, 0))),
            (slice(max(-down, 0), height + min(-down, 0)), slice(max(-right, 0), width + min(-right, 0))),
        )
