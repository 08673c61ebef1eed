"""The gallery, as far as it goes without Blender: what stands in for scans, the page, and names that agree."""

import ast
import importlib.util
from pathlib import Path

import numpy as np
import pytest

from devtools import gallery
from devtools.places import Failure

DEVTOOLS = Path(gallery.__file__).parent


@pytest.fixture
def data(monkeypatch, tmp_path):
    """The module that finds or makes the volumes, on a machine without any scan."""
    monkeypatch.syspath_prepend(str(DEVTOOLS))
    spec = importlib.util.spec_from_file_location("gallery_data", DEVTOOLS / "gallery_data.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    monkeypatch.setattr(module, "DATA", tmp_path / "nothing")
    return module


def table_of(name: str) -> dict:
    """A table of gallery_sets.py, which needs Blender to be imported: its keys with the source of their values."""
    for node in ast.parse((DEVTOOLS / "gallery_sets.py").read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Assign) and node.targets[0].id == name:
            return {key.value: ast.unparse(value) for key, value in zip(node.value.keys, node.value.values)}
    raise AssertionError(name)


def test_every_scene_has_a_set_and_a_volume(data):
    assert set(gallery.SCENES) == set(table_of("SETS")) == set(table_of("DATA_OF"))
    assert all(hasattr(data, ast.literal_eval(source)) for source in table_of("DATA_OF").values())


@pytest.mark.parametrize(
    ("name", "between"),
    [("head", (300, 2500)), ("chest", (60, 150)), ("brain", (100, 200)), ("smoke", (0.2, 1.0))],
)
def test_where_there_are_no_scans_numbers_stand_in_for_them(data, tmp_path, name, between):
    path, options, source = getattr(data, name)(tmp_path)
    voxels = np.frombuffer(path.read_bytes(), options["dtype"])
    assert voxels.size == np.prod(options["shape"]) and source == data.MADE
    seen = (voxels >= between[0]) & (voxels <= between[1])
    assert 0.002 < seen.mean() < 0.5


def test_the_made_chest_has_lungs_and_a_heart(data, tmp_path):
    path, options, _ = data.chest(tmp_path)
    labels = np.fromfile(data.organs(tmp_path, path, options["shape"]), np.uint8).reshape(options["shape"][::-1])
    voxels = np.fromfile(path, np.uint8).reshape(labels.shape)
    assert 0.03 < (labels == data.LUNGS).mean() < 0.3 and 0.002 < (labels == data.HEART).mean() < 0.1
    assert np.median(voxels[labels == data.LUNGS]) < 12 and 55 < np.median(voxels[labels == data.HEART]) < 160
    assert not labels[:, 0].any() and not labels[:, :, 0].any()  # the air around the body is nothing's


def test_the_page_tells_what_is_on_what_it_took_and_what_was_off():
    effects = [
        {"name": "shading", "on": True, "reason": "diffuse 0.8", "ms": 12.34},
        {"name": "specular", "on": True, "reason": "shininess 20", "ms": None},
        {"name": "shadows", "on": False, "reason": "no light casts any", "ms": 0.0},
    ]
    report = {
        "effects": effects, "stages_ms": {"total": 99.6}, "image": {"width": 8, "height": 6}, "source": "a scan",
        "threads": 2,
    }  # fmt: skip
    told = gallery.effect_table(report)
    assert "| shading | 12.3 | diffuse 0.8 |" in told and "| specular | within another |" in told
    assert "100 ms for 8 x 6 pixels of a scan, 2 thread(s). Off, for nothing: shadows." in told


@pytest.mark.parametrize(("names", "size", "said"), [(("moon",), "96x72", "moon"), ((), "wide", "wide")])
def test_what_is_not_in_the_gallery_is_refused_before_anything_is_made(names, size, said):
    with pytest.raises(Failure, match=said):
        gallery.gallery(names, size)
