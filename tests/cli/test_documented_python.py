"""The Python code of the README, of the tutorial and of three guides runs as it stands there."""

import ast
import builtins
import csv
import os
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest

import rle_splat
from devtools.docs import python_of

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs/how-to/use-from-python.md"
OTHERS = ROOT / "docs/how-to/python-with-other-libraries.md"
TUTORIAL = ROOT / "docs/tutorial/first-figure-from-python.md"
MEASURED = re.compile(r" *\d[\d.]*(?= (?:ms|8-bit|sample))")  # times and errors, which differ between machines
SIDE = 48  # voxels and pixels


@pytest.mark.slow  # it compiles the kernels of the quality fine under a sun
def test_the_example_of_the_readme_runs(tmp_path, monkeypatch):
    z, y, x = np.indices((SIDE, SIDE, SIDE)) - SIDE // 2
    values = np.float32(1000.0 * np.exp(-((np.sqrt(x**2 + y**2 + z**2) / (SIDE / 3)) ** 8)))
    rle_splat.write_volume(rle_splat.Volume(values, np.eye(4), space="patient"), tmp_path / "FLAIR.nrrd")
    monkeypatch.chdir(tmp_path)
    names = {}
    exec(compile(python_of(ROOT / "README.md"), "README.md", "exec"), names)
    assert 0.02 < (names["rendering"].rgba[..., 3] > 0.5).mean() < 0.5 and "flair" in names["why"]
    assert min((tmp_path / name).stat().st_size for name in ("brain.png", "brain.svg")) > 10_000


@pytest.mark.slow  # it compiles the kernels of all qualities under a sun
def test_the_tutorial_runs_and_prints_what_it_says(tmp_path, monkeypatch, capsys, data):
    shutil.copyfile(data / "flair_brain_124x160x140_uint8.nrrd", tmp_path / "FLAIR.nrrd")
    monkeypatch.chdir(tmp_path)
    names, checked = {}, 0
    page = TUTORIAL.read_text(encoding="utf-8")
    for kind, block in re.findall(r"^```(python|text)\n(.*?)^```", page, re.MULTILINE | re.DOTALL):
        if kind == "python":
            exec(compile(block, TUTORIAL.name, "exec"), names)
        else:
            checked += 1
            assert MEASURED.sub(" N", capsys.readouterr().out) == MEASURED.sub(" N", block)
    assert checked > 5 and names["within"].report["error"]["kept"] and (tmp_path / "brain.svg").stat().st_size > 10_000
    assert [path.name for path in (tmp_path / "pictures").iterdir()] == ["FLAIR.nrrd.png"]


@pytest.mark.slow  # it compiles the kernels of the quality fine under a recipe
def test_the_script_for_many_scans_goes_on_after_errors_and_leaves_out_what_is_made(tmp_path, monkeypatch):
    Image = pytest.importorskip("PIL.Image")
    pytest.importorskip("pydicom")
    from tests.read.dicom_phantoms import geometry, write_classic

    scans = tmp_path / "scans"
    scans.mkdir()
    ball = np.linalg.norm(np.indices((SIDE,) * 3) - SIDE / 2, axis=0) < SIDE / 3
    for name, unit in (("a", "HU"), ("broken", "HU"), ("killed", "HU"), ("mr", None)):
        volume = rle_splat.Volume(np.int16(2000 * ball - 1000), np.diag((3, 3, 3, 1)), space="patient", value_unit=unit)
        rle_splat.write_volume(volume, scans / f"{name}.nrrd")
    for distance in (3, 1.5, 2):  # mm between slices
        where = geometry("axial", (1, 0, 0), (0, 1, 0), np.arange(0, 18, distance))
        write_classic(scans / "study" / f"{distance}", where)
    (scans / "text.nrrd").write_text("no scan")
    (scans / ".hidden").write_text("")
    code = python_of(ROOT / "docs/how-to/picture-many-scans.md")
    dies = """    if path.name == "killed.nrrd":
        os.kill(os.getpid(), 9)
    if path.name == "broken.nrrd":
        raise ValueError("odd")
"""
    (tmp_path / "many.py").write_text(code.replace("    began, part", f"{dies}    began, part"), encoding="utf-8")

    def run(*numbers):
        env = {**os.environ, "PYTHONPATH": str(ROOT)}
        done = subprocess.run(
            [sys.executable, "many.py", *numbers], cwd=tmp_path, env=env, capture_output=True, text=True, check=True
        )
        return [line.partition(":")[0] for line in sorted(done.stdout.splitlines())]

    assert run("0") == ["a.nrrd"] and not (tmp_path / "scans.csv").exists()
    assert run() == ["broken.nrrd", "killed.nrrd", "mr.nrrd", "study", "text.nrrd"]
    assert run() == ["broken.nrrd", "killed.nrrd", "mr.nrrd", "text.nrrd"]
    assert sorted(path.name for path in (tmp_path / "pictures").glob("*.p*")) == ["a.nrrd.png", "study.png"]
    with open(tmp_path / "scans.csv", newline="", encoding="utf-8") as file:
        table = {row["name"]: row for row in csv.DictReader(file)}
    assert [float(row["seconds"]) > 0 for row in table.values() if not row["error"]] == [True, True]
    assert table["mr.nrrd"]["error"] == "This scan is no CT in HU."
    assert [table[name]["space"] for name in ("a.nrrd", "mr.nrrd", "study")] == ["patient", "", "patient"]
    assert table["broken.nrrd"]["error"].endswith("code 1. ValueError: odd")
    assert ("Signal 9" if os.name == "posix" else "code 9") in table["killed.nrrd"]["error"]
    assert "text.nrrd is not a NRRD file" in table["text.nrrd"]["error"]
    sheet = np.asarray(Image.open(tmp_path / "sheet.png"))
    assert sheet.shape == (840, 1080, 3) and (sheet[200, 180] > 60).all() and not sheet[200, 540].any()

    monkeypatch.chdir(tmp_path)
    names = {}
    exec(code.partition("PICTURES.mkdir")[0], names)
    assert names["read"](Path("scans/study")).spacing[2] == pytest.approx(1.5)


@pytest.mark.parametrize("page", (PAGE, OTHERS), ids=lambda page: page.stem)
def test_a_section_has_all_names_that_it_uses_or_says_which_section_it_continues(page):
    codes, checked = {}, 0
    for section in page.read_text(encoding="utf-8").split("\n## ")[1:]:
        title = section.partition("\n")[0]
        continued = re.match(r"\n\nContinues \[(.+?)\]\(#", section[len(title) :])
        blocks = re.findall(r"^```python\n(.*?)^```", section, re.MULTILINE | re.DOTALL)
        codes[title] = (codes[continued[1]] if continued else "") + "".join(blocks)
        nodes = list(ast.walk(ast.parse(codes[title])))
        names = [node for node in nodes if isinstance(node, ast.Name)]
        made = {node.id for node in names if isinstance(node.ctx, ast.Store)} | set(dir(builtins))
        made |= {node.name for node in nodes if isinstance(node, ast.FunctionDef | ast.ExceptHandler)}
        made |= {node.arg for node in nodes if isinstance(node, ast.arg)}
        made |= {node.asname or node.name for node in nodes if isinstance(node, ast.alias)}
        assert {node.id for node in names} <= made, title
        checked += bool(blocks)
    assert checked > 4


def _write_ball(folder):
    """Write the files that the pages name, of a hollow ball, into a folder; return its values and its volume."""
    z, y, x = np.indices((SIDE, SIDE, SIDE)) - SIDE // 2
    ball = np.clip(255.0 - 8.0 * np.abs(np.sqrt(x**2 + y**2 + z**2) - SIDE / 4), 0.0, 255.0)
    volume = rle_splat.Volume(ball.astype(np.uint8), np.eye(4))
    rle_splat.write_volume(volume, folder / "scan.nrrd")
    organs = np.where(ball > 128.0, 5, 0).astype(np.uint8)
    rle_splat.write_volume(replace(volume, voxels=organs), folder / "organs.nrrd")
    affine = np.diag((1.0, -2.0, 3.0, 1.0))
    placed = replace(volume, space="patient", affine=affine)
    for name in ("ct.nrrd", "t1.nii.gz", "FLAIR.nrrd"):
        rle_splat.write_volume(placed, folder / name)
    coarse = replace(volume, voxels=volume.voxels[::2, ::2, ::2], affine=np.diag((2.0, -4.0, 6.0, 1.0)), slope=0.1)
    rle_splat.write_volume(replace(coarse, space="patient", value_unit="SUVbw"), folder / "pet.nrrd")
    np.save(folder / "array.npy", ball)
    return ball, placed


def _run(page, *replaced):
    """The names that the code of a page makes; ``replaced``: texts in it and what stands for them, smaller sizes."""
    text, names = python_of(page), {}
    for old, new in replaced:
        assert old in text
        text = text.replace(old, new)
    exec(compile(text, str(page), "exec"), names)
    return names


@pytest.mark.slow  # it compiles the kernels of the quality fine
def test_the_documented_example_runs(tmp_path, monkeypatch, capsys):
    Image = pytest.importorskip("PIL.Image")
    _write_ball(tmp_path)
    monkeypatch.chdir(tmp_path)
    names = _run(
        PAGE, ("scan.nii.gz", "scan.nrrd"), ("organs.nii.gz", "organs.nrrd"),
        *((size, f"{SIDE}") for size in ("512", "800", "600")),
    )  # fmt: skip
    made = names["rendering"]
    assert made.rgba.shape == (SIDE, SIDE, 4) and made.rgba.dtype == np.float32 and made.depth.shape == (SIDE, SIDE)
    assert made.rgba[..., 3].max() > 0.5 and made.report["error"]["tolerance"] is None
    np.testing.assert_array_equal(names["of_array"].spacing, (0.5, 0.5, 2.0))
    assert np.asarray(Image.open("shown.png")).shape == (SIDE, SIDE, 3)
    uptake, pet = names["uptake"], rle_splat.read_volume("pet.nrrd")
    assert uptake.shape_xyz == names["scan"].shape_xyz and uptake.value_unit == "SUVbw"
    np.testing.assert_allclose(uptake.physical(uptake.voxels[::2, ::2, ::2]), pet.physical(pet.voxels), atol=1e-5)
    assert "100% Done" in capsys.readouterr().out


class _Mesh:
    """A mesh of PyVista: a level wall across the volume's middle, wherever it is moved."""

    points = np.array([(x, y, 1.5 * SIDE) for x, y in ((-999, -999), (-999, 999), (999, 999), (999, -999))])

    def __init__(self, *faces):
        self.regular_faces = np.reshape(faces, (-1, 3)).astype(int)

    def same(self, *_, **__):
        return self

    triangulate = transform = extrude_rotate = same


class _Plotter(SimpleNamespace):
    """A plotter of PyVista whose left half is a wall before all else, in white on black."""

    lights: ClassVar = []  # of all plotters

    def __init__(self, window_size, **_):
        width, height = window_size
        left = np.broadcast_to(np.arange(width) < width // 2, (height, width))
        super().__init__(
            camera=SimpleNamespace(), left=left,
            **dict.fromkeys(("set_background", "add_mesh", "close"), lambda *_, **__: None),
            add_light=self.lights.append, enable_parallel_projection=lambda: None,
        )  # fmt: skip

    def screenshot(self, return_img):
        return np.uint8(255 * np.dstack((self.left,) * 3))

    def get_image_depth(self, fill_value):
        return np.where(self.left, -1.0, fill_value)


@pytest.mark.slow  # it compiles the kernels of the quality fine under a sun
def test_the_code_for_other_libraries_runs(tmp_path, monkeypatch):
    """With stand-ins for PyVista and for layers of napari."""
    pytest.importorskip("SimpleITK")
    Image = pytest.importorskip("PIL.Image")
    ball, placed = _write_ball(tmp_path)
    monkeypatch.chdir(tmp_path)
    stand_in = SimpleNamespace(
        Plotter=_Plotter, Light=SimpleNamespace, MultipleLines=lambda points: _Mesh(0, 1, 2, 0, 2, 3)
    )
    monkeypatch.setitem(sys.modules, "pyvista", stand_in)
    gray = SimpleNamespace(map=lambda at: np.stack((at, at, at, np.ones_like(at)), axis=1))
    layer = SimpleNamespace(
        data=ball, scale=(2.0, 0.5, 0.5), translate=(3, 2, 1), contrast_limits=(50.0, 250.0), colormap=gray, gamma=2.0
    )
    segments = SimpleNamespace(**(vars(layer) | {"data": np.where(ball > 128.0, 5, 0)}))
    viewer = SimpleNamespace(layers={"nuclei": layer, "membranes": layer, "cells": segments})
    monkeypatch.setitem(sys.modules, "napari", SimpleNamespace(current_viewer=lambda: viewer))
    names = _run(OTHERS, ("1440", f"{SIDE}"), ("1080", f"{SIDE}"))
    for name in ("of_image", "of_nifti"):
        np.testing.assert_allclose(names[name].affine, placed.affine)
        np.testing.assert_array_equal(names[name].voxels, placed.voxels)
    grid = SimpleNamespace(
        direction_matrix=np.eye(3), spacing=(1.0, 2.0, 3.0), dimensions=(2, 3, 4), GetPoint=lambda _: (5.0, 6.0, 7.0),
        point_data={"values": np.arange(24.0)},
    )  # fmt: skip
    of_grid = names["from_pyvista"](grid, "values", space="patient")
    np.testing.assert_array_equal(of_grid.affine @ (1, 1, 1, 1), (6.0, 8.0, 10.0, 1.0))
    assert of_grid.shape_xyz == (2, 3, 4) and of_grid.voxels[1, 0, 1] == 7.0
    shown = np.int16(Image.open("electrode.png").convert("RGB"))
    half = SIDE // 4
    assert shown.shape == (SIDE // 2, SIDE // 2, 3) and (shown[:, :half] == 255).all() and not shown[-1, -1].any()
    lit = Image.fromarray(names["with_mesh"](names["scene"], _Mesh(), "fine")).convert("RGB").reduce(2)
    assert (np.int16(lit) - shown)[:, half:].max() > 30  # the shadow

    assert [light.color for light in _Plotter.lights] == [(1.0, 1.0, 1.0)] * 2
    lamp = replace(names["scene"], lights=(rle_splat.Light(type="POINT"),))
    with pytest.raises(rle_splat.RleSplatError, match="type POINT"):
        names["with_mesh"](lamp, _Mesh())

    cells = names["cells"]
    np.testing.assert_array_equal(cells.volume.affine[:3, 3], (1, 2, 3))
    np.testing.assert_allclose(cells.transfer_function.color[8][1:], rle_splat.decode_srgb(0.25))  # half, by gamma
    assert cells.volume.unit == "um" and names["image_of"](layer, "mm")[0].unit == "mm"
    assert rle_splat.render(cells).rgba[..., 3].max() > 0.5 and np.asarray(Image.open("cells.png")).max() > 30
    colored = rle_splat.render(replace(names["scene"], transfer_function=names["viridis"])).rgba
    assert colored[..., 3].max() > 0.3
