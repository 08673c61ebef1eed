"""Figures as people read them."""

import pytest

from rle_splat.runtime.figures import figure_text, percent_text


@pytest.mark.parametrize("value, text", [
    (0.0, "0"), (3e-7, "< 0.0001"), (0.00042, "0.00042"), (0.0996, "0.10"), (0.996, "1.0"), (1.26, "1.3"),
    (9.96, "10"), (13.4, "13"), (134.0, "134"), (1.5e6, "1500000"), (float("inf"), "inf"),
])  # fmt: skip
def test_two_significant_digits_without_an_exponent(value, text):
    assert figure_text(value) == text


@pytest.mark.parametrize("share, text", [
    (0.0, "0%"), (1e-6, "< 0.1%"), (0.004, "0.4%"), (0.0123, "1.2%"), (0.1234, "12%"), (0.5, "50%"),
    (0.998, "> 99%"), (1.0, "100%"),
])  # fmt: skip
def test_shares_in_percent_are_neither_none_nor_all_unless_they_are(share, text):
    assert percent_text(share) == text
