"""Names in figures: where their lines lead, where they stand, and which are left out."""

from dataclasses import replace

import numpy as np
import pytest

from rle_splat.figure.lettering import text_width
from rle_splat.figure.make import figure_steps, make_figure
from rle_splat.figure.names import find_names, names_of
from rle_splat.figure.page import Fill, Text, Tile
from rle_splat.figure.plan import Figure, FigureStyle, Name, Panel
from rle_splat.figure.words import in_words
from rle_splat.runtime.steps import drain
from rle_splat.scene import Clip, Labels, Quality, RleSplatError
from rle_splat.volume.volume import Volume

from .conftest import BALLS, SHAPE_XYZ

NAMES = {0: "outside", 1: "kidney_left", 2: "right kidney", 3: "nowhere"}
STYLE = FigureStyle(width_cm=6.0, dpi=100.0, font_size=6.0, caption="", color_bar=False, scale_bar="off", sides="off")


@pytest.fixture
def scene(drawing):
    """Two balls, the first one labeled 1, the second one 2."""
    found = drawing.scene(style=STYLE)
    x = np.broadcast_to(np.arange(SHAPE_XYZ[0]), found.volume.voxels.shape)
    numbers = np.where(found.volume.voxels > 0.0, np.where(x < 10, 1, 2), 0).astype(np.uint8)
    return replace(found, labels=Labels(Volume(numbers, found.volume.affine), names=NAMES))


def made(scene, names=None, style=STYLE):
    panel = Panel(scene, names=names_of(scene) if names is None else names)
    return drain(figure_steps(Figure((panel,), style), [Quality.preset("draft")]))


def texts_of(page) -> dict:
    return {one.text: one for one in page.items if isinstance(one, Text)}


def ends_of(page) -> list:
    """The middles of the balls at the ends of lines, from the left."""
    found = {tuple(np.round(np.mean(one.points, axis=0), 6)) for one in page.items if isinstance(one, Fill)}
    return sorted(found)


def place_of(scene, voxel) -> np.ndarray:
    """Where an orthographic view from the front shows a voxel: mm from the corner of the picture."""
    middle = 0.5 * (np.array(SHAPE_XYZ) - 1.0)
    across = scene.volume_matrix[:3, :3] @ (np.array(voxel) - middle)  # in a space whose front is -y
    height = scene.height / STYLE.pixels_per_mm
    per_unit = max(scene.width, scene.height) / STYLE.pixels_per_mm / scene.camera.ortho_scale
    return np.array((0.5 * scene.width / STYLE.pixels_per_mm, 0.5 * height)) + per_unit * across[[0, 2]] * (1.0, -1.0)


def test_lines_lead_to_what_they_name(scene):
    page = made(scene).page
    (tile,) = (one for one in page.items if isinstance(one, Tile))
    texts, ends = texts_of(page), ends_of(page)
    assert set(texts) == {"Left kidney", "Right kidney"} and len(ends) == 2
    for end, ball in zip(ends, sorted(BALLS), strict=True):
        radius = np.linalg.norm(place_of(scene, ball) - place_of(scene, np.add(ball, (0, 0, 1.5))))
        assert np.linalg.norm(np.subtract(end, (tile.x, tile.y)) - place_of(scene, ball)) < radius
    left, right = texts["Left kidney"], texts["Right kidney"]
    assert left.anchor == "end" and left.x < ends[0][0] < ends[1][0] < right.x and right.anchor == "start"


def test_a_point_is_named_where_it_is(scene):
    middle = (scene.index_to_world @ (*BALLS[0], 1.0))[:3]
    page = made(scene, (Name("Here", point=tuple(middle)), Name("Behind", point=(1e9, 0.0, 0.0)))).page
    (tile,) = (one for one in page.items if isinstance(one, Tile))
    (end,) = ends_of(page)
    assert end == pytest.approx(place_of(scene, BALLS[0]) + (tile.x, tile.y), abs=1e-4) and set(texts_of(page)) == {
        "Here"
    }


def test_what_is_hidden_or_cut_away_or_behind_a_camera_has_no_name(scene):
    hidden = replace(scene, labels=replace(scene.labels, functions={1: None}))
    assert set(texts_of(made(hidden).page)) == {"Right kidney"}
    away = np.eye(4)
    away[:3, :3] = [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]
    away[:3, 3] = (scene.index_to_world @ (9.5, 6.0, 7.0, 1.0))[:3]
    kept = {keep: made(replace(scene, clips=(Clip("plane", away, keep),))).page for keep in ("inside", "outside")}
    assert sorted(tuple(texts_of(page)) for page in kept.values()) == [("Left kidney",), ("Right kidney",)]
    around = scene.camera.matrix_world @ np.diag((-1.0, 1.0, -1.0, 1.0))
    behind = replace(scene, camera=replace(scene.camera, type="PERSP", matrix_world=around))
    assert find_names(behind, names_of(scene)) == ({}, (0.0, 0.0))


def test_names_stand_beside_what_is_visible_and_not_on_one_another(scene):
    long = {1: "a name of so many words that it takes several lines", 2: "right kidney"}
    figure = make_figure(
        replace(scene, labels=replace(scene.labels, names=long)), style=STYLE, quality="draft", names=True
    )
    page = figure.page
    (tile,) = (one for one in page.items if isinstance(one, Tile))
    seen = np.flatnonzero((tile.rgba[..., 3] > 0.02).any(axis=0)) / page.pixels_per_mm + tile.x
    lines = [one for one in page.items if isinstance(one, Text)]
    assert len(lines) > 3 and " ".join(one.text for one in lines if one.anchor == "end").startswith("A name of")
    for one in lines:
        width = text_width(one.text, one.size)
        begin, end = (one.x - width, one.x) if one.anchor == "end" else (one.x, one.x + width)
        assert end < seen.min() or begin > seen.max()
        assert tile.x <= begin and end <= tile.x + tile.rgba.shape[1] / page.pixels_per_mm
    for anchor in ("start", "end"):
        heights = sorted(one.y for one in lines if one.anchor == anchor)
        assert np.diff(heights).min(initial=9.0) > STYLE.font_size * 25.4 / 72.0


def test_names_in_words():
    words = {
        "vertebrae_T12": "T12", "kidney_left": "Left kidney", "aorta": "Aorta", "vertebra": "Vertebra",
        "heart_atrium_left": "Left atrium", "lung_upper_lobe_left": "Upper lobe of left lung",
        "rib_left_1": "Left 1st rib", "rib_right_12": "Right 12th rib", "iliac_vena_left": "Left iliac vein",
        "iliac_artery_left": "Left iliac artery", "autochthon_left": "Left autochthonous back muscles",
        "gluteus_maximus_left": "Left gluteus maximus", "portal_vein_and_splenic_vein": "Portal and splenic veins",
        "kidney_cyst_left": "Cyst of left kidney", "vertebrae_body": "Vertebral bodies", "small_bowel": "Small bowel",
        "thigh_medial_compartment_left": "Medial compartment of left thigh", "teeth_lower": "Lower teeth",
        "ventricle_body_right": "Body of right lateral ventricle", "hip_implant": "Hip implant",
        "upper_left_canine_fdi23": "Upper left canine (23)", "upper_left_canine_pulp_fdi123": "Upper left canine pulp",
    }  # fmt: skip
    of_other_programs = {
        "Left-Hippocampus": "Left-Hippocampus", "heart ventricle left": "Left heart ventricle", "Vertebra_L1": "L1",
        "hip": "Hip", "rib 5": "Rib 5", "Lung_L": "Lung L", "ventricle wall left": "Left ventricle wall",
    }  # fmt: skip
    words |= of_other_programs
    assert {name: in_words(name) for name in words} == words


def test_bad_names_are_one_sentence(scene):
    many = replace(scene.labels, names={1: "x " * 200})
    for figure, sentence in (
        (lambda: made(replace(scene, labels=many)), "has no room for 1 names"),
        (lambda: made(scene, (Name("\u982d", 1),)), "A name in the figure has the character"),
        (lambda: Name("both", 1, (0.0, 0.0, 0.0)), "either a segment or a point"),
        (lambda: Name("neither"), "either a segment or a point"),
    ):
        with pytest.raises(RleSplatError, match=sentence):
            figure()
    assert names_of(replace(scene, labels=None)) == ()
    assert names_of(replace(scene, labels=replace(scene.labels, names={1: " _ "}))) == ()
