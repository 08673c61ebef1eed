"""Letters against the affine, captions against the scene, and pages against their files."""

import base64
import io
import json
import unicodedata
from dataclasses import asdict, replace
from xml.etree import ElementTree

import numpy as np
import pytest

from rle_splat.classify.presets import PRESETS, fit_preset, preset
from rle_splat.classify.transfer_function import Shade
from rle_splat.figure.directions import NO_BREAK, cube, edge_letters, view_name
from rle_splat.figure.framing import frame_steps
from rle_splat.figure.layout import PageDraft, automatic_caption
from rle_splat.figure.lettering import FONT, check_text, outlines_of, text_width, wrap
from rle_splat.figure.make import figure_steps, make_figure
from rle_splat.figure.page import Fill, Page, Stroke, Text, Tile
from rle_splat.figure.plan import Figure, FigureStyle, Panel, tile_size
from rle_splat.figure.raster import _area_cover, draw
from rle_splat.figure.svg import svg_text
from rle_splat.pipeline.render import render
from rle_splat.pipeline.stage_cache import StageCache
from rle_splat.runtime.steps import drain
from rle_splat.scene import Clip, Labels, Quality, RleSplatError
from rle_splat.scene.display import to_bytes
from rle_splat.scene.png import png_bytes
from rle_splat.segment.body import NAMES
from rle_splat.view.projection import world_to_pixel
from rle_splat.volume.volume import Volume

from .conftest import RED

BLACK = (0.0, 0.0, 0.0)


# --- letters of the patient's sides -----------------------------------------------------------------------------------

LPS_TO_LETTERS = {(1, 0, 0): "L", (-1, 0, 0): "R", (0, 1, 0): "P", (0, -1, 0): "A", (0, 0, 1): "S", (0, 0, -1): "I"}
AFFINES = {
    "LPS": np.diag((1.0, 1.0, 1.0, 1.0)),
    "RAS": np.diag((-1.0, -1.0, 1.0, 1.0)),
    "SRA": np.array([[0.0, -1.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]),
}


@pytest.mark.parametrize("name", AFFINES)
@pytest.mark.parametrize("view", [(0.0, 0.0), (90.0, 0.0), (180.0, 0.0), (0.0, 90.0), (35.0, 20.0)])
def test_letters_are_where_the_sides_are(drawing, balls, name, view):
    scene = drawing.scene(
        balls(affine=AFFINES[name], space="patient"), view={"azimuth": view[0], "elevation": view[1]},
        volume_matrix=np.eye(4),
    )  # fmt: skip
    letters = edge_letters(scene)
    project = world_to_pixel(scene.camera, scene.width, scene.height)[:2, :3]
    # On the screen, to the right and down: how far a step toward each side of the patient goes.
    steps = {letter: project @ np.array(way, float) for way, letter in LPS_TO_LETTERS.items()}
    for edge, axis, sign in (("left", 0, -1), ("right", 0, 1), ("top", 1, -1), ("bottom", 1, 1)):
        first = letters[edge][0]
        assert sign * steps[first][axis] == pytest.approx(max(sign * step[axis] for step in steps.values()))
        assert len(letters[edge]) == 1 or sign * steps[letters[edge][1]][axis] > 0.0


def test_the_front_shows_the_right_on_the_left(drawing, balls):
    scene = drawing.scene(balls(space="patient"))
    assert edge_letters(scene) == {"left": "R", "right": "L", "top": "S", "bottom": "I"}
    assert view_name(scene) == "Anterior view"


@pytest.mark.parametrize(("azimuth", "elevation", "name"), [
    (30.0, 0.0, "Left anterior oblique 30°"), (-45.0, 20.0, "Right anterior oblique 45°, cranial\u00a020°"),
    (135.0, 0.0, "Left posterior oblique 45°"), (-90.0, 0.0, "Right lateral view"),
    (0.0, -30.0, "Anterior view, caudal\u00a030°"), (0.0, 90.0, "Superior view"),
])  # fmt: skip
def test_views_have_the_names_of_radiologists(drawing, balls, azimuth, elevation, name):
    view = {"azimuth": azimuth, "elevation": elevation}
    assert view_name(drawing.scene(balls(space="patient"), view=view)) == name
    assert view_name(drawing.scene(balls(), view=view)) == ""


def test_a_cube_shows_the_three_sides_that_face_the_viewer(drawing, balls):
    items = cube(drawing.scene(balls(space="patient"), view={"azimuth": 40.0, "elevation": 30.0}), 0.0, 0.0, 5.0, 2.0)
    assert {item.text for item in items if isinstance(item, Text)} == {"L", "A", "S"}
    assert sum(isinstance(item, Fill) for item in items) == 3
    front = cube(drawing.scene(balls(space="patient")), 0.0, 0.0, 5.0, 2.0)
    assert [item.text for item in front if isinstance(item, Text)] == ["A"]


def test_sides_that_are_unknown_are_not_invented(drawing):
    made = drawing.made(drawing.scene())
    assert any("not known where the patient's sides are" in remark for remark in made.remarks)
    with pytest.raises(RleSplatError, match="sides are; state the orientation of the volume"):
        drawing.made(drawing.scene(), style=replace(drawing.style, sides="letters"))


# --- the page and its files -------------------------------------------------------------------------------------------


WORDS = '5 µm < 7 & "ü"'


def some_page(background=(1.0, 1.0, 1.0)) -> Page:
    tile = np.zeros((20, 30, 4), np.float32)
    tile[5:15, 5:25] = 0.5, 0.1, 0.0, 0.5
    items = (
        Tile(1.0, 1.0, tile), Fill(((5.0, 5.05), (8.0, 5.05), (8.0, 5.5), (5.0, 5.5)), (0.2, 0.4, 0.6)),
        Stroke(((1.0, 7.0), (9.0, 7.0)), 0.4, BLACK),
        Text(5.0, 9.0, WORDS, 2.0, BLACK, "middle", halo=(1.0,) * 3),
    )  # fmt: skip
    return Page(100, 100, 254.0, background, items)


def test_pixels_are_covered_by_their_share():
    drawn = draw(some_page(None))
    assert drawn.shape == (100, 100, 4)
    assert np.array_equal(drawn[15:25, 15:35], np.broadcast_to(np.float32((0.5, 0.1, 0.0, 0.5)), (10, 20, 4)))
    bar = drawn[50:56, 50:80]
    assert bar[0, 5] == pytest.approx(0.5 * np.array((0.2, 0.4, 0.6, 1.0)), abs=1e-6)  # half of a row of pixels
    assert bar[..., 3].sum() == pytest.approx(30 * 4.5, rel=1e-3)
    line = drawn[66:74, 12:40, 3]  # beside the text
    assert line.sum(axis=0) == pytest.approx(np.full(28, 4.0), abs=1e-3)


@pytest.mark.parametrize("background", [None, (1.0, 1.0, 1.0), (0.0, 0.0, 0.0)])
def test_a_png_is_read_back_by_another_program(background):
    Image = pytest.importorskip("PIL.Image")
    drawn = draw(some_page(background))
    image = Image.open(io.BytesIO(png_bytes(drawn, 254.0, background)))
    assert np.array_equal(np.asarray(image), to_bytes(drawn, background))
    assert image.info["dpi"] == pytest.approx((254.0, 254.0), abs=0.01) and image.info["srgb"] == 0
    assert png_bytes(drawn, background=background) == png_bytes(drawn, 300.0, background)


def test_an_svg_holds_texts_lines_and_pictures():
    Image = pytest.importorskip("PIL.Image")
    page = some_page()
    root = ElementTree.fromstring(svg_text(page).encode())
    space = "{http://www.w3.org/2000/svg}"
    assert root.get("width") == "10mm" and root.get("viewBox") == "0 0 10 10"
    assert [text.text for text in root.iter(f"{space}text")] == [WORDS]
    assert root.find(f"{space}polygon").get("points") == "5,5.05 8,5.05 8,5.5 5,5.5"
    assert root.find(f"{space}polyline").get("points") == "1,7 9,7"
    picture = root.find(f"{space}image")
    assert (picture.get("width"), picture.get("height")) == ("3", "2")
    kind, _, content = picture.get("{http://www.w3.org/1999/xlink}href").partition(",")
    assert kind == "data:image/png;base64"
    pixels = np.asarray(Image.open(io.BytesIO(base64.b64decode(content))))
    assert np.array_equal(pixels, to_bytes(page.items[0].rgba, page.background))


def test_a_figure_of_text_and_pictures_stays_within_its_page(drawing, balls):
    style = replace(drawing.style, width_cm=7.0, caption=None, columns=2)
    views = ({"azimuth": 0.0}, {"azimuth": 90.0}, {"azimuth": 50.0})
    scenes = [drawing.scene(balls(space="patient", value_unit="HU"), style, 3, view=view) for view in views]
    titles = ["Front", "Left", "A title that takes more than one line, for sure"]
    page = drawing.made(*scenes, style=style, titles=titles).page
    wide, tall = page.size_mm
    for item in page.items:
        if isinstance(item, Text):
            width = text_width(item.text, item.size)
            left = item.x - {"start": 0.0, "middle": 0.5, "end": 1.0}[item.anchor] * width
            assert left >= 0.0 and left + width <= wide and item.size <= item.y <= tall, item
    caption = " ".join(item.text for item in page.items if isinstance(item, Text) and item.x == 1.0)
    assert "indow" not in caption and "20 × 12 × 14 voxels of 1 × 1 × 1\u00a0mm" in caption
    assert " Orthographic projection. " in caption, "each view has its title"


def test_the_caption_names_a_view_that_all_pictures_have(drawing, balls):
    def caption(*scenes):
        return automatic_caption(PageDraft(Figure(tuple(map(Panel, scenes)), drawing.style)))

    volume = balls(space="patient")
    front, left = (drawing.scene(volume, view={"azimuth": azimuth}) for azimuth in (0.0, 90.0))
    other = replace(front, transfer_function=preset("ct-bone"))
    assert all(" Anterior view, orthographic projection. " in caption(*one) for one in ((front,), (front, other)))
    above = drawing.scene(volume, view={"elevation": 30.0, "perspective": True})
    assert f" Anterior view, cranial{NO_BREAK}30°, perspective projection. " in caption(above)
    for scenes in ((front, left), (drawing.scene(),)):  # several views, and sides that are not known
        assert "view" not in caption(*scenes)


@pytest.mark.parametrize(
    "change, words",
    [
        (lambda bone: bone, "CT Bone."),
        (lambda bone: bone.remapped(bone.span[0] - 100.0, bone.span[1] - 100.0, "HU"), "CT Bone, shifted by −100 HU."),
        (lambda bone: bone.remapped(0.0, 900.0, "HU"), "CT Bone, mapped to 0 to 900 HU."),
        (
            lambda bone: replace(bone, opacity=(*bone.opacity[:-1], (2000.0, 0.9))),
            "CT Bone, modified: opacity 0 at 270, 0.35 at 450, 0.75 at 900, 0.9 at 2000 HU.",
        ),
        (
            lambda bone: replace(bone, opacity=tuple((500.0 + 50.0 * n, 0.1 + 0.1 * n) for n in range(7))),
            "CT Bone, modified.",
        ),
        (lambda bone: replace(bone, opacity_unit_distance=0.05), "CT Bone, opacity unit distance 0.05 mm."),
        (lambda bone: replace(bone, name="Mine", opacity_unit_distance=0.05), "Mine."),
    ],
)  # fmt: skip
def test_the_caption_says_how_the_transfer_function_differs_from_its_preset(drawing, balls, change, words):
    scene = drawing.scene(balls(value_unit="HU"), function=change(preset("ct-bone")))
    caption = automatic_caption(PageDraft(Figure((Panel(scene),), drawing.style)))
    assert caption.startswith(f"Transfer function {words} ")


@pytest.mark.parametrize("name", [name for name in PRESETS if not name.startswith("ct-")])
def test_the_caption_calls_no_fitted_preset_modified(drawing, balls, name):
    volume = balls(value_unit="HU")
    function, _ = fit_preset(name, volume)
    caption = automatic_caption(PageDraft(Figure((Panel(drawing.scene(volume, function=function)),), drawing.style)))
    assert f"Transfer function {function.name}, mapped to " in caption and "modified" not in caption


def test_the_caption_says_how_far_surfaces_are_smoothed(drawing, balls):
    def caption(quality=None, **shade):
        style = replace(drawing.style, caption=None)
        scene = drawing.scene(balls(), style)
        function = replace(scene.transfer_function, shade=Shade(**shade) if shade else None)
        page = make_figure(replace(scene, transfer_function=function), quality=quality, style=style, fill=False).page
        return " ".join(item.text for item in page.items if isinstance(item, Text))

    assert " Surfaces smoothed by 1.5\u00a0mm for light. " in caption(smoothness=1.5)
    for other in (caption(smoothness=0.0), caption(), caption(Quality(classification="pre"), smoothness=1.5)):
        assert "moothed" not in other


def test_the_caption_says_which_panels_are_cut_smoothed_or_of_other_voxels(drawing, balls):
    other = balls(affine=np.diag((0.5, 1.0, 1.0, 1.0)))
    scenes = drawing.scene(), drawing.scene(clips=(Clip("plane"),)), drawing.scene(other, clips=(Clip("plane"),))
    caption = automatic_caption(PageDraft(Figure(tuple(map(Panel, scenes)), drawing.style), [0.0, 1.5, 0.0]))
    voxels = f"20 × 12 × 14 voxels of {{}} × 1 × 1{NO_BREAK}mm".format
    assert f" (a, b) {voxels(1)}; (c) {voxels(0.5)}. (b, c) cut by 1 plane. " in caption
    assert f" (b) surfaces smoothed by 1.5{NO_BREAK}mm for light. " in caption and "idden" not in caption


def test_the_caption_counts_what_cuts(drawing):
    plane, box = Clip("plane"), Clip("box")
    for clips, words in (((plane, box, box), " Cut by 1 plane and 2 boxes. "), ((box,), " Cut by 1 box. "), ((), "")):
        figure = Figure((Panel(drawing.scene(clips=clips)),), drawing.style)
        caption = automatic_caption(PageDraft(figure))
        assert words in caption and ("Cut" in caption) == bool(clips)


@pytest.mark.parametrize("hidden, words", (
    ((0,), " Hidden: what is outside all segments. "), ((1,), " Hidden: 1 segment. "),
    ((0, 1, 2), " Hidden: what is outside all segments and 2 segments. "),
))  # fmt: skip
def test_the_caption_counts_hidden_segments(drawing, hidden, words):
    scene = drawing.scene()
    everywhere = np.zeros(scene.volume.voxels.shape, np.uint8)
    labels = Labels(Volume(everywhere, scene.volume.affine), dict.fromkeys(hidden), {1: "Of a patient"})
    caption = automatic_caption(PageDraft(Figure((Panel(replace(scene, labels=labels)),), drawing.style)))
    assert words in caption and "Of a patient" not in caption
    assert "Hidden" not in automatic_caption(PageDraft(Figure((Panel(scene),), drawing.style)))


def test_the_caption_says_that_a_table_is_hidden(drawing):
    scene = drawing.scene()
    everywhere = Volume(np.ones(scene.volume.voxels.shape, np.uint8), scene.volume.affine, named_labels=NAMES)
    labels = Labels(everywhere, {0: None})
    caption = automatic_caption(PageDraft(Figure((Panel(replace(scene, labels=labels)),), drawing.style)))
    assert " Hidden: what lies beside the body. " in caption


# --- lettering --------------------------------------------------------------------------------------------------------


# Widths of Helvetica in thousandths of an em, from Adobe's metrics of the font; Arial and SVG programs have them, too.
HELVETICA = {
    "A": 667,
    "i": 222,
    "m": 833,
    "W": 944,
    "0": 556,
    " ": 278,
    "g": 556,
    "%": 889,
    "@": 1015,
    "Ä": 667,
    "°": 400,
}


@pytest.mark.parametrize("character", HELVETICA)
def test_letters_are_as_wide_as_those_of_svg(character):
    assert text_width(character, 1000.0) == pytest.approx(HELVETICA[character], abs=1.0)
    assert text_width(f"x{character}", 3.0) == pytest.approx(text_width("x", 3.0) + text_width(character, 3.0))


def test_every_character_has_outlines_within_a_line():
    for character in json.loads(FONT.read_text(encoding="utf-8"))["glyphs"]:
        outlines, width = outlines_of(character, 1.0)
        assert bool(outlines) == (unicodedata.category(character) != "Zs"), character
        for outline in outlines:
            assert -0.4 < outline[:, 0].min() and outline[:, 0].max() < width + 0.4, character
            assert -0.35 < outline[:, 1].min() and outline[:, 1].max() < 1.15, character


def test_accents_are_drawn_and_unknown_characters_refused():
    plain, marked = outlines_of("A", 1.0)[0], outlines_of("Ä", 1.0)[0]
    assert len(marked) == len(plain) + 2 and marked[-1][:, 1].min() > plain[0][:, 1].max()
    assert np.array_equal(outlines_of("A\u0308", 1.0)[0][-1], marked[-1]), "composed of a letter and a mark"
    assert check_text("Größe: 5 µm – «x» Ελλάδα, Москва, Việt Nam, ≤ 3", "A text")
    with pytest.raises(RleSplatError, match="A text has the character '漢'"):
        check_text("a漢b", "A text")


def _cover(polygons, width=12, height=10):
    rows, columns, cover = _area_cover((height, width), [np.array(one, float) for one in polygons])
    whole = np.zeros((height, width))
    whole[rows, columns] = cover
    return whole


@pytest.mark.parametrize("seed", range(5))
def test_areas_cover_what_points_within_them_say(seed):
    """A star with a hole, partly outside: against 64 x 64 points a pixel, each within the side that its angle meets."""
    rng = np.random.default_rng(seed)
    middle, angles = np.array([6.0, 5.0]), 2.0 * np.pi * (np.arange(11) + rng.uniform(0.0, 0.8, 11)) / 11
    star = rng.uniform(2.0, 6.5, (11, 1)) * np.stack((np.cos(angles), np.sin(angles)), axis=1)
    steps = (np.arange(64) + 0.5) / 64
    x, y = np.meshgrid((np.arange(12)[:, None] + steps).ravel() - 6.0, (np.arange(10)[:, None] + steps).ravel() - 5.0)
    side = (np.searchsorted(angles, np.arctan2(y, x) % (2.0 * np.pi)) - 1) % 11
    (ax, ay), (bx, by) = star[side].transpose(2, 0, 1), star[(side + 1) % 11].transpose(2, 0, 1)
    inside = [(bx - ax) * (y - share * ay) - (by - ay) * (x - share * ax) > 0.0 for share in (1.0, 0.4)]
    wanted = (inside[0] & ~inside[1]).reshape(10, 64, 12, 64).mean(axis=(1, 3))
    assert np.abs(_cover([star + middle, 0.4 * star[::-1] + middle]) - wanted).max() < 0.02


def test_areas_are_exact():
    box = [(1.25, 2.5), (4.0, 2.5), (4.0, 5.75), (1.25, 5.75)]
    cover = _cover([box])
    assert cover[2:6, 1:4] == pytest.approx(np.outer([0.5, 1.0, 1.0, 0.75], [0.75, 1.0, 1.0]))
    assert cover.sum() == pytest.approx(2.75 * 3.25)
    assert _cover([[(-3.0, 1.0), (20.0, 1.0), (20.0, 2.5), (-3.0, 2.5)]])[:3] == pytest.approx(
        np.repeat([[0.0], [1.0], [0.5]], 12, axis=1)
    )


@pytest.mark.parametrize(
    "about, sentence", [({"unit": "尺"}, "The unit of lengths"), ({"value_unit": "值"}, "The unit of the values")]
)
def test_what_cannot_be_lettered_is_refused_before_anything_is_rendered(drawing, balls, about, sentence):
    with pytest.raises(RleSplatError, match=f"{sentence} has the character"):
        next(figure_steps(Figure((Panel(drawing.scene(balls(**about))),), drawing.style), [None]))
    strange = drawing.scene(function=replace(RED, name="骨"))
    with pytest.raises(RleSplatError, match="The figure's caption has the character"):
        next(figure_steps(Figure((Panel(strange),), replace(drawing.style, caption=None)), [None]))


def test_lines_are_broken_at_spaces():
    lines = wrap("one two  three extraordinarily four", 2.0, 12.0)
    assert " ".join(lines) == "one two three extraordinarily four" and len(lines) >= 3
    assert all(text_width(line, 2.0) <= 12.0 or " " not in line for line in lines)
    assert wrap("one\u00a0two three", 2.0, 1.0) == ["one\u00a0two", "three"]


@pytest.mark.parametrize(
    ("background", "color", "ink"),
    [("white", (1.0, 1.0, 1.0), 0.0), ("black", (0.0, 0.0, 0.0), 1.0), ("transparent", None, 0.0),
     ([0.0, 0.0, 0.8], (0.0, 0.0, 0.8), 1.0), (np.array((0.2, 0.2, 0.2)), (0.2, 0.2, 0.2), 0.0)],
)  # fmt: skip
def test_lettering_is_white_on_dark_backgrounds(drawing, background, color, ink):
    style = replace(drawing.style, background=background, caption="Ball")
    assert style == FigureStyle(**json.loads(json.dumps(asdict(style))))
    page = drawing.made(drawing.scene(), style=style).page
    assert page.background == color
    assert {item.color for item in page.items if isinstance(item, Text)} == {(ink,) * 3}


@pytest.mark.parametrize(
    "wrong, sentence",
    [
        ({"width_cm": 0.1}, "width cm must be from 1 to 200"),
        ({"dpi": float("nan")}, "dpi must be from 20 to 2400"),
        ({"columns": -1}, "columns must be a whole number"),
        ({"background": "pink"}, "background must be white, black, transparent"),
        ({"sides": "yes"}, "sides must be auto, letters, cube, off"),
        ({"scale_bar": 0.0}, "scale bar must be a length above zero"),
        ({"scale_depth": "near"}, "scale depth must be a length above zero, or 'center'"),
        ({"caption": "a\u6f22"}, "caption has the character"),
    ],
)
def test_a_wrong_style_is_refused(wrong, sentence):
    with pytest.raises(RleSplatError, match=sentence):
        FigureStyle(**wrong)


def test_a_figure_needs_panels_of_one_size_and_room(drawing):
    with pytest.raises(RleSplatError, match="at least one panel"):
        Figure(())
    sizes = [Panel(drawing.scene(style=FigureStyle(width_cm=width, dpi=50.0))) for width in (3.0, 4.0)]
    with pytest.raises(RleSplatError, match="all have the same size"):
        Figure(tuple(sizes))
    with pytest.raises(RleSplatError, match="use fewer columns"):
        tile_size(FigureStyle(width_cm=2.0, dpi=50.0, columns=9), 9)
    with pytest.raises(RleSplatError, match="lower its dpi"):
        tile_size(FigureStyle(width_cm=100.0, dpi=2400.0), 1)


# --- figures of the Python interface ----------------------------------------------------------------------------------


def test_what_is_visible_fills_the_pictures_at_one_scale(drawing, balls):
    """Two balls 11 mm apart, each 5 mm across: 16 by 5 mm from the front, 5 by 5 mm from the side."""
    front, side = (drawing.scene(balls(), view={"azimuth": azimuth, "fit": 3.0}) for azimuth in (0.0, 90.0))
    made = make_figure([front, side], ("front", "side"), drawing.style, Quality.preset("draft"))
    panels = made.figure.panels
    assert [panel.title for panel in panels] == ["front", "side"]
    assert len({panel.scene.camera.ortho_scale for panel in panels}) == 1
    shares = []
    for one in made.renderings:
        seen = np.argwhere(one.rgba[..., 3] > 0.02)
        low, high = seen.min(axis=0), seen.max(axis=0) + 1
        middle = 0.5 * (low + high) / one.rgba.shape[:2]
        assert middle == pytest.approx([0.5, 0.5], abs=0.03)
        shares.append((high - low) / one.rgba.shape[:2])
    assert shares[0][1] == pytest.approx(1.0 / 1.16, abs=0.04), "the widest fills its picture, with room for letters"
    assert shares[0][1] / shares[1][1] == pytest.approx(16.0 / 5.0, rel=0.15), "the other has the same scale"
    assert made.figure.style.aspect == 1.5
    unmoved = make_figure(front, style=drawing.style, quality=Quality.preset("draft"), fill=False)
    assert np.array_equal(unmoved.figure.panels[0].scene.camera.matrix_world, front.camera.matrix_world)


def test_an_empty_or_perspective_view_is_left_as_it_is(drawing, balls):
    empty = drawing.scene(balls(), function=replace(RED, opacity=((0.0, 0.0), (100.0, 0.0))))
    perspective = drawing.scene(balls(), style=drawing.style, view={"perspective": True})
    for scene in (empty, perspective):
        figure = Figure((Panel(scene),), drawing.style)
        assert drain(frame_steps(figure, StageCache())) is figure


def test_pictures_are_the_means_of_finer_ones(drawing, balls):
    scene = drawing.scene(balls())
    made = drawing.made(scene)
    (tile,) = (item for item in made.page.items if isinstance(item, Tile) and item.rgba.shape[0] == scene.height)
    finer = render(replace(scene, width=2 * scene.width, height=2 * scene.height), Quality.preset("draft")).rgba
    wanted = 0.25 * (finer[::2, ::2] + finer[1::2, ::2] + finer[::2, 1::2] + finer[1::2, 1::2])
    assert np.abs(tile.rgba - wanted).max() < 1e-6 and wanted.max() > 0.5


def test_finer_pictures_are_not_smoothed_twice(drawing, balls):
    plain, smooth = (drawing.made(drawing.scene(balls(), antialias=on)) for on in (False, True))
    assert np.array_equal(plain.renderings[0].rgba, smooth.renderings[0].rgba)


def _lengths(made) -> list[str]:
    return [item.text for item in made.page.items if isinstance(item, Text) and item.text[:1].isdigit()]


def test_equal_scale_bars_are_drawn_once(drawing, balls):
    volume, other = balls(), balls(affine=np.diag((2.0, 2.0, 2.0, 1.0)))
    same = drawing.made(drawing.scene(volume, count=2), drawing.scene(volume, count=2, view={"azimuth": 90.0}))
    assert [text for text in _lengths(same) if "mm" in text] == ["5 mm, all panels"]
    several = drawing.made(drawing.scene(volume, count=2), drawing.scene(other, count=2))
    assert [text for text in _lengths(several) if "mm" in text] == ["5 mm", "10 mm"]


def test_notebooks_show_figures_and_renderings(drawing, balls):
    made = drawing.made(drawing.scene(balls()))
    Image = pytest.importorskip("PIL.Image")
    assert Image.open(io.BytesIO(made._repr_png_())).size == (made.page.width, made.page.height)
    rendering = made.renderings[0]
    assert np.array_equal(np.asarray(Image.open(io.BytesIO(rendering._repr_png_()))), rendering.to_srgb())


@pytest.mark.parametrize(
    "titles, sentence", [(("a", "b"), "There are 2 titles for 1 scenes"), (("\u6f22",), "A title of the figure has")]
)
def test_titles_must_fit_the_scenes(drawing, titles, sentence):
    with pytest.raises(RleSplatError, match=sentence):
        make_figure(drawing.scene(), titles, drawing.style)
