"""The prices of effects, at a tiny size: each turns its effect on and nothing else, and off costs nothing."""

import numpy as np
import pytest

from benchmarks import effects, effects_page
from benchmarks.frames import circumstances
from benchmarks.scenes import shells
from rle_splat.effects.analyze import EFFECTS, analyze
from rle_splat.scene import Quality

QUALITY = Quality.preset("draft", threads=1)
PLAIN = effects.Setting("shells", *shells(24), False, ("shading", "clip objects"))
LIT = effects.Setting("shells", *shells(24), True, ("specular", "mesh occlusion"))
KNOWN = [label for label, price in effects.PRICES.items() if price.effect in EFFECTS]


def test_every_effect_of_the_table_has_a_price():
    """The headlight has none of its own: shading is priced under it."""
    assert set(EFFECTS) - {price.effect for price in effects.PRICES.values()} <= {"headlight"}


@pytest.mark.parametrize("setting", [PLAIN, LIT], ids=["plain", "lit"])
@pytest.mark.parametrize("label", KNOWN)
def test_a_price_turns_its_effect_on(label, setting):
    base, price = setting.at(effects.AZIMUTH, 512), effects.PRICES[label]
    with_it = analyze(effects.given(base, label), QUALITY)
    assert with_it[price.effect].on
    over = base if price.over is None else effects.given(base, price.over)
    gone = set(analyze(over, QUALITY).on) ^ set(with_it.on)
    assert gone <= {price.effect, "headlight", "shading", "specular", "lights"}, label


def test_rows_say_what_was_made_and_that_off_is_nothing():
    rows = {row["effect"]: row for row in effects.measure(LIT, QUALITY, 16, 1)}
    assert list(rows) == ["specular", "mesh occlusion", effects.ALL, "all off by hand"]
    assert rows["specular"]["made_by_a_frame"] == []  # what shines is made where a sheet is sampled
    assert rows["mesh occlusion"]["made_by_a_frame"] == []
    assert rows["all off by hand"]["more_kernels"] == rows["all off by hand"]["fewer_kernels"] == []
    for row in rows.values():
        assert row["off_ms"] == 0.0 and np.isfinite([row["first_ms"], row["frame_ms"]]).all()


def test_lens_and_shutter_have_a_row_of_their_own():
    lens = effects.Setting("shells", *shells(24), False, ("clipping", "depth of field"))
    rows = {row["effect"]: row for row in effects.measure(lens, QUALITY, 384, 1)}
    assert list(rows) == ["clipping", "depth of field", effects.ALL, effects.ALL_PICTURES, "all off by hand"]
    assert "depth of field" not in rows[effects.ALL]["on"] and "depth of field" in rows[effects.ALL_PICTURES]["on"]


def test_a_scene_s_table_replaces_its_own_and_no_other(tmp_path):
    for name in ("effects.md", "effects.json"):
        if (effects_page.DOCS / name).exists():
            (tmp_path / name).write_text((effects_page.DOCS / name).read_text(encoding="utf-8"), encoding="utf-8")

    def report(scene, milliseconds):
        row = {
            "scene": scene, "effect": "mode mip", "of": "mode", "over": "base", "first_ms": 3.0, "first_ratio": 1.5,
            "frame_ms": milliseconds, "frame_ratio": 2.5, "own_first_ms": {"mode": 7.0}, "off_ms": 0.0,
            "more_kernels": ["one"], "made_by_a_frame": [],
        }  # fmt: skip
        where = circumstances(1) | {"others_busy_cores": 0.1}
        return {"rows": [row], "circumstances": where, "size": 16, "quality": "draft", "classification": "post",
                "light_pass": None}  # fmt: skip

    for scene, milliseconds in (("plain CT", 111.0), ("smoke", 222.0), ("plain CT", 333.0)):
        effects_page.write_page(report(scene, milliseconds), tmp_path)
    page = (tmp_path / "effects.md").read_text(encoding="utf-8")
    plain, smoke = (page.partition(f"<!-- begin prices of {name} -->")[2].partition("<!-- end")[0]
                    for name in ("plain CT", "smoke"))  # fmt: skip
    assert "| mode mip | base | 3 (1.50) | 333 (2.50) | 7 | 1 | nothing |" in plain and "111" not in page
    assert "222 (2.50)" in smoke and "Off: 0 ms in every row" in plain


def test_table_and_report(read_rows, capsys, monkeypatch):
    monkeypatch.setattr(effects, "settings", lambda: (PLAIN,))
    arguments = ["--size", "16", "--repeats", "1", "--side", "24", "--quality", "draft"]
    assert effects.main(arguments) == 0
    rows = read_rows("effects")
    assert [row["effect"] for row in rows] == ["shading", "clip objects", "all together", "all off by hand"]
    said = capsys.readouterr().out
    assert "Not priced: none." in said and all(row["effect"] in said for row in rows)
