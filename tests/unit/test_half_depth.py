"""The series by which the depth channel finds logarithms."""

import numpy as np

from rle_splat.splat.half_depth import LOG2_OVER_T


def test_the_series_is_the_logarithm_to_its_stated_error():
    t = np.linspace(1e-6, 1.0, 2001)
    np.testing.assert_allclose(np.polynomial.Polynomial(LOG2_OVER_T)(t), np.log2(1.0 + t) / t, rtol=2e-8)
