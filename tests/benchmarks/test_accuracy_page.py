"""Proves that docs/explanation/accuracy.md is filled from measurements: every place in it has its table, the tables say
what was measured, knobs are turned one at a time, and the smoke is the same on every machine."""

from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks import accuracy as page
from benchmarks.scenes import smoke
from rle_splat.accuracy.planner.measure_plans import sweep_steps
from rle_splat.classify.presets import fit_preset
from rle_splat.runtime.steps import drain
from rle_splat.scene import Quality

OPTIONS = SimpleNamespace(size=32, probes=60, repeats=1, threads=1)  # no kernels to compile


@pytest.fixture(scope="module")
def subject():
    plume = smoke((20, 18, 28))
    return page.Subject("smoke", plume, fit_preset("smoke", plume)[0], (30.0, 15.0))


@pytest.fixture(scope="module")
def measured(subject):
    return page.measure(subject, False, OPTIONS, with_knobs=True)


def test_the_smoke_is_smoke_and_always_the_same():
    plume = smoke((20, 18, 28))
    assert plume.voxels.shape == (28, 18, 20) and plume.voxels.dtype == np.float32
    assert (plume.voxels == smoke((20, 18, 28)).voxels).all()
    assert plume.voxels.min() == 0.0 and 0.3 < plume.voxels.max() <= 1.0
    assert 0.05 < (plume.voxels > 0.0).mean() < 0.6
    assert not plume.voxels[0].any() and not plume.voxels[-1].any()


def test_each_variant_turns_one_knob():
    """Of what standard is with its classification."""
    for name, plan in page.variants(page.STANDARD).items():
        usual = Quality.preset("standard", classification=plan.classification)
        changed = [field for field in vars(plan) if getattr(plan, field) != getattr(usual, field)]
        knob = name.split(":")[0]
        assert set(changed) - {"name"} <= {knob.split(" (")[0].replace(" ", "_")}, name


def test_every_place_of_the_page_is_filled(subject, measured, tmp_path):
    report, names = measured[0].report, {"smoke": measured[1]}
    options = SimpleNamespace(output=tmp_path, **vars(OPTIONS))
    page.write_page(options, {"smoke, orthographic": report}, {"smoke": report}, names, ["On a machine."])
    text = "".join((tmp_path / name).read_text(encoding="utf-8") for name in ("accuracy.md", "accuracy-measured.md"))
    parts = text.split("<!-- begin ")[1:]
    assert len(parts) == 5 and all(len(part.split("<!-- end ")[0]) > 60 for part in parts)
    assert "On a machine." in text
    standard = next(entry for entry in report["plans"] if entry["chosen"])
    wanted = f"{page.figure_text(standard['error']['rmse'])} / {page.figure_text(standard['error']['largest'])}"
    assert f"{standard['frame_ms']:.0f} ms, {wanted}" in text
    assert page.fill(text, {}) == text
    with pytest.raises(ValueError, match="nowhere"):
        page.fill(text, {"nowhere": "x"})


def test_a_plan_that_only_one_view_has_is_left_open_elsewhere(measured):
    report = measured[0].report
    less = {**report, "plans": [entry for entry in report["plans"] if entry["name"] != "fine"]}
    row = next(line for line in page.plans_table({"a": less, "b": report}).splitlines() if line.startswith("| fine "))
    assert row.split("|")[3].strip() == "-" and " ms, " in row.split("|")[4]


def test_the_tolerance_table_names_the_quickest_that_keeps_it(measured):
    report = measured[0].report
    truth = page._main_truth({"view": report})
    rows = page.tolerance_table({"view": report}).splitlines()[2:]
    for tolerance, row in zip(page.TOLERANCES, rows):
        keeps = [
            entry for entry in report["plans"]
            if entry["truth"] == truth and entry["error"]["largest"] <= tolerance and not page.is_variant(entry)
        ]  # fmt: skip
        said = row.split("|")[2].strip()
        if keeps:
            best = min(keeps, key=lambda entry: entry["frame_ms"])
            assert said == f"{best['frame_ms']:.0f} ms, {best['name']}"
        else:
            assert said.startswith("not reached")


def test_knobs_are_told_as_factors_of_standard(measured):
    report, names = measured[0].report, measured[1]
    for knob in page.KNOBS:
        points = page.knob_points(report, names, knob)
        built = [name for name in page.variants(page.STANDARD) if name.startswith(f"{knob}: ")]
        assert len(points) == len(built) > 1 and all(error > 0.0 and ms > 0.0 for _, error, ms in points)
    density = {value: error for value, error, _ in page.knob_points(report, names, "sheet density")}
    assert density["2"] < density["0.5"]
    row = next(line for line in page.knobs_table({"s": report}, {"s": names}).splitlines() if "sheet density" in line)
    by_name = {entry["name"]: entry for entry in report["plans"]}
    half, whole = (by_name[names[f"sheet density: {d}"]]["error"]["rmse"] for d in ("0.5", "1"))
    assert f"0.5: ×{page.figure_text(half / whole)}" in row and "**1**" in row


@pytest.mark.extras
def test_no_line_joins_depth_rules_of_two_families(measured, tmp_path, monkeypatch):
    pytest.importorskip("matplotlib")
    report, names = measured[0].report, measured[1]
    drawn = []
    monkeypatch.setattr(page, "save", lambda figure, *_: drawn.append(figure))
    page.knobs_plot({"smoke": report}, {"smoke": names}, tmp_path / "a.png")
    rules, density = drawn[0].axes[:2]
    lines = [list(line.get_xdata(orig=True)) for line in rules.lines]
    assert [line[0] for line in lines] == ["slice-2", "preintegrated"]
    assert [rule for line in lines for rule in line] == list(page.DEPTH_RULES)
    assert len(density.lines) == 1
    assert [text.get_text() for text in drawn[0].legends[0].get_texts()] == ["smoke"]


def test_a_narrow_transfer_function_is_what_pre_is_worst_at(subject):
    hard = page.narrow(subject)
    low, high = subject.volume.value_range
    band = [value for value, alpha in hard.function.opacity]
    assert 0.0 < band[-1] - band[0] < 0.03 * (high - low)
    plans = [Quality(name="only", classification="pre")]
    soft, narrow = (
        drain(sweep_steps(s.scene(32, False), plans, plans[0], probes=60, repeats=1)).plan("only")["as_ray_caster"]
        for s in (subject, hard)
    )
    assert narrow["rmse"] > 2.0 * soft["rmse"]


@pytest.mark.extras
def test_a_sweep_is_plotted(subject, tmp_path):
    pytest.importorskip("matplotlib")
    image = pytest.importorskip("PIL.Image")
    measured = page.measure(subject, False, OPTIONS, with_knobs=False)
    page.plot_sweep(measured[0], tmp_path / "a.png", ".png", "smoke")
    pixels = np.asarray(image.open(tmp_path / "a.png").convert("RGB"))
    assert min(pixels.shape[:2]) > 800 and len(np.unique(pixels.reshape(-1, 3), axis=0)) > 200
