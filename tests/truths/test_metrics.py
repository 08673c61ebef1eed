"""Proves the measures: SSIM and FLIP of pictures whose figure is known, and what probe pixels allow to be said."""

import numpy as np
import pytest

from benchmarks import flip
from rle_splat.accuracy.metrics import LEVEL, difference, display_encoded, ssim, ssim_map
from rle_splat.accuracy.probes import choose_probes, error_summary, probe_errors, share_above, statement


def picture(seed=0, size=(32, 40)):
    """A premultiplied picture with soft blots."""
    random = np.random.default_rng(seed)
    y, x = np.mgrid[: size[0], : size[1]]
    alpha = np.zeros(size)
    for _ in range(5):
        cx, cy = random.random(2) * size[::-1]
        alpha += 0.4 * np.exp(-((x - cx) ** 2 + (y - cy) ** 2) / 40.0)
    alpha = np.minimum(alpha, 1.0)
    return np.concatenate((alpha[..., None] * random.random(3), alpha[..., None]), axis=-1)


def test_display_encoding_by_hand():
    """sRGB's two branches, the background under what is transparent, and clipping."""
    rgba = np.array(((0.5, 0.001, 2.0, 1.0), (0.0, 0.0, 0.0, 0.0), (0.1, 0.0, 0.0, 0.5)))[None]
    found = display_encoded(rgba, (0.25, 0.25, 0.25))[0]
    np.testing.assert_allclose(found[0], (0.735357, 0.01292, 1.0), atol=1e-6)
    np.testing.assert_allclose(found[1], 0.537099, atol=1e-6)
    np.testing.assert_allclose(found[2], (0.511668, 0.388573, 0.388573), atol=1e-5)


def test_ssim_is_its_definition():
    """One window at a time, with weights and moments as the paper has them."""
    image, reference = (display_encoded(picture(seed)) for seed in (1, 2))
    found = ssim_map(image, reference)
    assert found.shape == (22, 30, 3)
    at = np.arange(-5, 6)
    weights = np.exp(-(at[:, None] ** 2 + at**2) / (2.0 * 1.5**2))
    weights /= weights.sum()
    for row, column, channel in ((0, 0, 0), (11, 17, 1), (21, 29, 2)):
        a, b = (p[row : row + 11, column : column + 11, channel] for p in (image, reference))
        mean_a, mean_b = (weights * a).sum(), (weights * b).sum()
        var_a, var_b = (weights * (a - mean_a) ** 2).sum(), (weights * (b - mean_b) ** 2).sum()
        both = (weights * (a - mean_a) * (b - mean_b)).sum()
        expected = (2 * mean_a * mean_b + 1e-4) * (2 * both + 9e-4)
        expected /= (mean_a**2 + mean_b**2 + 1e-4) * (var_a + var_b + 9e-4)
        assert found[row, column, channel] == pytest.approx(expected, rel=1e-9)
    assert ssim(picture(1), picture(1)) == pytest.approx(1.0, abs=1e-12)
    assert ssim(picture(1), picture(2)) == pytest.approx(found.mean(), rel=1e-12) and found.mean() < 0.9
    with pytest.raises(ValueError, match="11 pixels"):
        ssim_map(image[:10], reference[:10])


def test_flip_without_its_package(monkeypatch):
    monkeypatch.setattr(flip, "flip_evaluator", None)
    assert flip.mean_flip(picture(1), picture(2)) is None


@pytest.mark.extras
@pytest.mark.skipif(flip.flip_evaluator is None, reason="the package flip-evaluator is not in this environment")
def test_flip_grows_with_what_is_seen():
    """Equal pictures 0, black against white 1 but for rounding, and a louder fault above a fainter one."""
    flat = np.zeros((32, 32, 4))
    flat[..., 3] = 1.0
    white = flat + (1.0, 1.0, 1.0, 0.0)
    assert flip.mean_flip(flat, flat) == 0.0
    assert flip.mean_flip(white, flat) > 0.9
    base = picture(1)
    faint, loud = (flip.mean_flip(base + strength * picture(2), base) for strength in (0.01, 0.3))
    assert 0.0 < faint < 0.3 * loud


def test_difference_of_probes_is_in_levels():
    errors = probe_errors([[0.0, 0.0, 0.0, 0.0], [0.5, 0.1, 0.0, 1.0]], [[0.0] * 4, [0.5, 0.1, 2.0 * LEVEL, 1.0]])
    np.testing.assert_allclose(errors, (0.0, 2.0))
    assert difference(np.full((5, 4), 3.0 * LEVEL), np.zeros((5, 4))).p999 == pytest.approx(3.0)


def test_differences_are_their_definitions():
    """One value in a thousand off by 100 levels, the others by 1: the 99.9th percentile lies between them."""
    image = np.full(2000, LEVEL)
    image[[7, 1500]] = -100.0 * LEVEL
    found = difference(image, np.zeros(2000))
    square = (1998.0 + 2.0 * 100.0**2) / 2000.0
    assert found.largest == pytest.approx(100.0) and found.rmse == pytest.approx(square**0.5)
    assert found.psnr == pytest.approx(20.0 * np.log10(255.0 / square**0.5))
    assert found.p999 == pytest.approx(np.quantile(np.abs(image), 0.999) / LEVEL) and found.p999 > 1.0
    assert found.bias == pytest.approx((1998.0 - 200.0) / 2000.0) and found.count == 2000


def test_probes_are_everywhere_and_where_it_is_steep():
    rgba = np.zeros((60, 80, 4))
    rgba[20:40, 30:50] = 0.7
    probes = choose_probes(rgba, 400, seed=3)
    assert 270 <= probes.random <= 300 and len(probes.columns) - probes.random == 100
    assert probes.columns.max() < 80 and probes.rows.max() < 60 and probes.of(rgba).shape == (len(probes.rows), 4)
    steep = set(zip(probes.rows[probes.random :].tolist(), probes.columns[probes.random :].tolist()))
    beside = {(r, c) for r in (19, 20, 39, 40) for c in range(29, 51)} | {
        (r, c) for c in (29, 30, 49, 50) for r in range(19, 41)
    }
    assert steep <= beside
    # Drawn at random: every eighth of the picture has its share.
    drawn = np.histogram2d(probes.rows[: probes.random], probes.columns[: probes.random], (2, 4), ((0, 60), (0, 80)))[0]
    assert drawn.min() > 0.6 * probes.random / 8
    np.testing.assert_array_equal(probes.centers[0], probes.columns + 0.5)
    small = choose_probes(rgba[:3, :4], 1000)
    assert small.random <= 12 and len(small.columns) <= 24


def test_share_above_is_the_binomial_bound():
    """The rule of three, and for failures the share at which so few would be seen once in twenty times."""
    assert share_above(0, 1000) == 0.003 and share_above(0, 2) == 1.0
    assert share_above(5, 5) == share_above(0, 0) == 1.0
    random = np.random.default_rng(1)
    for failed, count in ((1, 100), (4, 300), (40, 200)):
        share = share_above(failed, count)
        seen = random.binomial(count, share, 400_000)
        assert (seen <= failed).mean() == pytest.approx(0.05, abs=0.002)
        assert share > failed / count


def test_metrics_keep_random_and_steep_probes_apart():
    errors = np.concatenate((np.full(500, 0.3), np.full(100, 0.9)))
    found = error_summary(errors, 500, 0.5)
    assert found["random"] == {"count": 500, "failed": 0, "largest": 0.3, "rmse": pytest.approx(0.3)}
    assert found["steep"]["failed"] == 100 and found["largest"] == 0.9 and not found["kept"]
    assert found["share"] == 0.006
    assert found["sentence"] == (
        "None of 500 random sample pixels differs from the reference by more than 0.5 in 8-bit steps: at "
        "95% confidence at most 0.60% of the pixels do."
    )
    assert error_summary(errors, 500, 1.0)["kept"]
    two = "2 of 500 random sample pixels differ from the reference by more than 1 in 8-bit steps: "
    assert statement(2, 500, 1.0).startswith(two)
    assert error_summary(np.zeros(0), 0, 1.0)["share"] == 1.0
