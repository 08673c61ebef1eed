"""Any effects at once, P4: what every picture keeps to, however many of them a scene is given.

No truth is asked for here: pictures are finite and in range, the same bits whoever makes them and whatever part of them
is made, the kernels' stages are those of their reference implementations, and effects that are turned off leave no
trace.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import event, given
from hypothesis import strategies as st

from rle_splat.pipeline.stage_cache import StageCache
from rle_splat.runtime.jit import compiled, use_reference
from rle_splat.scene import RleSplatError
from tests.stability.effect_strategies import BLURS, scenes_with_effects
from tests.stability.fuzz import examples
from tests.stability.references import by_stages
from tests.stability.strategies import qualities
from tests.stability.test_scene_fuzz import (
    WORST,
    bits_apart,
    brightest,
    check_references,
    check_sentence,
    picture,
    record_references,
)

# Of many sharp pictures that a blurred one is the mean of, so many are held against the reference's.
FEW = 2


def check_range(made, most):
    """Finite, premultiplied and in range; ``most``: the largest channel of a color, as far as the warp knows it."""
    rgba, depth = made.rgba.astype(np.float64), made.depth
    assert np.isfinite(rgba).all() and np.isfinite(depth).all()
    assert rgba.min(initial=0.0) >= 0.0 and rgba[..., 3].max(initial=0.0) <= 1.0
    assert (rgba[..., :3] <= most * rgba[..., 3:] * (1.0 + 1e-6) + 1e-6 * most).all()


def crop_of(scene, shares):
    """(left, top, right, bottom) of a part of the picture, at least a pixel of it."""
    (left, right), (top, bottom) = (
        (min(int(a * size), size - 1), min(int(a * size) + 1 + int(b * size), size))
        for a, b, size in ((*shares[:2], scene.width), (*shares[2:], scene.height))
    )
    return left, top, right, bottom


@given(scenes_with_effects(), qualities(), st.tuples(*[st.floats(0.0, 1.0)] * 4))
@examples(20, shrink=False)
def search_effects(given_scene, quality, shares):
    scene, plain, names = given_scene
    cache = StageCache()
    try:
        made, splats, warps = by_stages(scene, quality, cache)
    except RleSplatError as problem:
        check_sentence(problem)
        return
    for name in names:
        event(name)
    most = max([brightest(scene), 1.0, *(rest[-1] for _, rest, _ in warps)])
    check_range(made, most)
    assert bits_apart(made, picture(scene, replace(quality, threads=2))) == 0
    assert bits_apart(made, by_stages(scene, quality, cache)[0]) == 0
    left, top, right, bottom = crop_of(scene, shares)
    part = picture(replace(scene, crop=(left, top, right, bottom)), quality)
    rgba, depth = (each[top:bottom, left:right].copy() for each in (made.rgba, made.depth))
    assert bits_apart(replace(made, rgba=rgba, depth=depth), part) == 0
    never, off = picture(plain, quality), picture(replace(scene, effects=dict.fromkeys(names, False)), quality)
    assert (never is None and off is None) or bits_apart(never, off) == 0
    if not compiled() or (set(names) & set(BLURS)):
        return
    with use_reference():
        reference, by_reference, _ = by_stages(scene, quality)
    check_range(reference, most)
    check_references(splats[:FEW], warps[:FEW], by_reference[:FEW])


def test_P4_any_effects_at_once(record):
    WORST.clear()
    search_effects()
    why = "bits are counted"
    record("P4", "pictures with effects that are not finite, in range and premultiplied", 0, 0, "either", why)
    claim = "bits that differ with two threads, a second time, in a part, and from a scene without"
    record("P4", claim, 0, 0, "either", why)
    if compiled():
        record_references(record, "P4")
