"""A picture in sections is the picture but for rounding, in any projection; along z one reads no more than its part."""

from dataclasses import replace
from functools import reduce

import numpy as np
import pytest

import rle_splat
from rle_splat.encode.store import read_encoded
from rle_splat.pipeline import encode_folder
from rle_splat.pipeline.render import render
from rle_splat.pipeline.sections import composite_steps, over, section_steps
from rle_splat.runtime.steps import drain
from rle_splat.scene import Clip, Mist, RleSplatError
from rle_splat.splat.sample_lamps import LEAST
from rle_splat.view.turntable import turntable
from tests.unit.test_folder import QUALITIES, scene_of, volume_of
from tests.ways import NUMPY

EXACT = 1e-6  # how far the order of float32 sums may move a number
ABOVE = np.array(((1, 0, 0, 0), (0, 0.8, -0.6, 0), (0, 0.6, 0.8, 9), (0, 0, 0, 1)), float)
MESH = np.array((((-40, 2, -40), (40, 1, -40), (0, -2, 50)),), float)


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """Classification -> a folder of tables in sections of three planes."""
    folder = tmp_path_factory.mktemp("sections")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(encode_folder._Chunks, "planes_at_once", lambda *_: 3)
        for name, quality in QUALITIES.items():
            rle_splat.encode_folder(scene_of(volume_of()), folder / f"{name}.rle", quality)
    return {name: folder / f"{name}.rle" for name in QUALITIES}


@pytest.fixture
def scene(folders):
    """``scene("post", axis=2, mist=...)``: a scene of a folder."""

    def make(name, axis=1, **changes):
        changes = {"lights": (), "headlight": False, **changes}
        return replace(scene_of(volume_of(), axis), volume=read_encoded(folders[name]), **changes)

    return make


def in_sections(scene, quality, count):
    """The Rendering of a picture in sections, and the largest color of its medium."""
    sections = [drain(section_steps(scene, quality, number, count)) for number in range(count)]
    together = reduce(over, sections)
    return drain(composite_steps(scene, quality, together)), together.most_color


def seen_from(azimuth, elevation, fit=1.25):
    """What a perspective camera changes; a small ``fit`` puts it into the volume."""
    camera, matrix = turntable(volume_of(), azimuth, elevation, fit, True, 60.0)
    return {"camera": camera, "volume_matrix": matrix}


@pytest.mark.parametrize("name", QUALITIES)
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_sections_along_each_axis(scene, name, axis):
    quality = replace(QUALITIES[name], termination=0.0)
    whole = render(scene(name, axis), quality)
    assert whole.rgba[..., 3].max() > 0.9
    for count in (1, 3):
        made, _ = in_sections(scene(name, axis), quality, count)
        assert np.abs(made.rgba - whole.rgba).max() < EXACT * (count > 1) + 1e-30
        assert (made.depth == made.depth.max()).all()  # no depth anywhere


@pytest.mark.parametrize("name", QUALITIES)
def test_sections_that_are_drawn_at_the_same_time(scene, name):
    """As by the threads of a worker, which share the volume: each of them takes a step in turn."""
    quality, shared = replace(QUALITIES[name], termination=0.0), scene(name, 2)
    alone = [drain(section_steps(scene(name, 2), quality, number, 3)) for number in range(3)]
    ends, running = {}, {number: section_steps(shared, quality, number, 3) for number in range(3)}
    while running:
        for number, steps in list(running.items()):
            try:
                next(steps)
            except StopIteration as end:
                ends[number] = end.value
                del running[number]
    for number, section in enumerate(alone):
        for mine, its in zip(ends[number].pixels, section.pixels, strict=True):
            np.testing.assert_array_equal(mine, its)


def test_tables_are_mapped_while_others_are_checked(scene, monkeypatch):
    """As when two threads draw along different axes."""
    mapped = scene("post").volume.mapped
    mapped.table("rows.runs")
    size_of = mapped._members.size

    def size(name):
        if name == "rows.runs":
            mapped.table("across.runs")
        return size_of(name)

    monkeypatch.setattr(mapped._members, "size", size)
    mapped.check_sizes()
    assert set(mapped._mapped) == {"rows.runs", "across.runs"}


@pytest.mark.parametrize("name", QUALITIES)
def test_what_ends_a_ray_early_is_lost_and_no_more(scene, name):
    """Nor more than what shares the light of a sample before, where samples are lit: that begins anew in a section."""
    quality = replace(QUALITIES[name], termination=1 / 64)
    whole = render(scene(name), quality).rgba
    made, most_color = in_sections(scene(name), quality, 4)
    off = np.abs(made.rgba - whole).max()
    assert EXACT < off <= quality.termination * max(most_color, 1.0) * (1.0 + LEAST * (name == "post"))


SCENES = {
    "perspective": lambda: seen_from(30.0, 20.0),
    "through several axes": lambda: seen_from(43.0, 33.0, 0.5),
    "from within": lambda: seen_from(43.0, 33.0, 0.05),
    "mist": lambda: {"mist": Mist(start=2.0, depth=60.0)},
    "a plane that cuts": lambda: {"clips": (Clip("plane", ABOVE),)},
    "a box that is hollowed out": lambda: {"clips": (Clip("box", np.diag((5.0, 6.0, 4.0, 1.0)), "outside"),)},
    "a mesh": lambda: {"triangles": MESH, **seen_from(30.0, 20.0)},
    "a crop": lambda: {"crop": (7, 5, 33, 30)},
}


@NUMPY
@pytest.mark.parametrize("name", SCENES)
def test_sections_under_effects(scene, name, way):
    quality = replace(QUALITIES["post"], termination=0.0, axis_fade=15.0)
    one = scene("post", 1, **SCENES[name]())
    whole = render(one, quality)
    made, _ = in_sections(one, quality, 3)
    assert whole.rgba[..., 3].max() > 0.3
    assert np.abs(made.rgba - whole.rgba).max() < EXACT
    on = [[effect["name"] for effect in each.report["effects"] if effect["on"]] for each in (made, whole)]
    assert on[0] == on[1]
    assert made.report["volume"] == whole.report["volume"] and "memory_bytes" not in made.report


@NUMPY
def test_more_sections_than_sheets(scene, way):
    quality = QUALITIES["pre"]
    sheets = render(scene("pre"), quality).report["plan"]["base_planes"][0]["sheets"]
    sections = [drain(section_steps(scene("pre"), quality, number, 2 * sheets)) for number in (0, 1)]
    assert [section.pixels for section in sections[:1]] == [(None,)] and sections[1].most_color > 0.0
    assert not drain(composite_steps(scene("pre"), quality, sections[0])).rgba.any()


@NUMPY
def test_the_tree_has_no_say_beyond_rounding(scene, way):
    quality = QUALITIES["pre"]
    one, two, three = (drain(section_steps(scene("pre"), quality, number, 3)) for number in range(3))
    for left, right in zip(over(over(one, two), three).pixels, over(one, over(two, three)).pixels, strict=True):
        assert np.abs(left - right).max() < EXACT


@NUMPY
def test_a_section_along_z_reads_no_other_part_of_the_folder(scene, folders, way):
    """Damage in the last planes is told by the section that has them, and does not touch the others."""
    quality = QUALITIES["post"]
    sound = [drain(section_steps(scene("post", 2), quality, number, 4)) for number in range(4)]
    file = folders["post"] / "rows.scalars"
    content = file.read_bytes()
    file.write_bytes(content[:-64] + bytes(64))
    try:
        found = []
        for number in range(4):
            try:
                found.append(drain(section_steps(scene("post", 2), quality, number, 4)))
            except RleSplatError as problem:
                assert "the checksum of rows.scalars does not fit in planes 15 to 16" in str(problem)
                found.append(None)
    finally:
        file.write_bytes(content)
    assert found[0] is None and None not in found[1:]  # seen from above, the last planes are the first section
    for some, others in zip(found[1:], sound[1:], strict=True):
        np.testing.assert_array_equal(some.pixels[0], others.pixels[0])


@NUMPY
def test_a_quarter_along_z_opens_half_of_six_parts(scene, way):
    """Of parts of three planes: a quarter of the planes and their neighbors lie in three of them."""
    quality = QUALITIES["post"]
    opened = {}
    for number, count in ((0, 1), (1, 4)):
        one = scene("post", 2)
        drain(section_steps(one, quality, number, count))
        opened[count] = sorted(key[1] for key in one.volume.opened if isinstance(key, tuple))
    assert opened == {1: [0, 1, 2, 3, 4, 5], 4: [2, 3, 4]}


def test_a_blurred_picture_and_a_volume_in_memory_are_refused(scene):
    blurred = replace(scene("pre").camera, aperture_radius=0.2, focus_distance=10.0)
    for wrong, sentence in (
        (scene("pre", camera=blurred), "Depth of field, motion blur and anti-aliasing mix many pictures"),
        (scene_of(volume_of()), "Slabs are parts of a folder of tables"),
    ):
        with pytest.raises(RleSplatError, match=sentence):
            drain(section_steps(wrong, QUALITIES["pre"], 0, 2))
