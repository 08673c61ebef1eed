"""Names in the pictures of a figure: of segments and of points, at both sides, with lines to them."""

import math

import numpy as np

from ..effects.clips import half_spaces
from ..scene import RleSplatError, Scene
from ..segment.label_map import BACKGROUND
from ..view.projection import depth_row, world_to_pixel
from .callouts import find_places, split, spread
from .lettering import text_width, wrap
from .page import Fill, Stroke, Text
from .plan import Name, Panel
from .scale import pixels_per_world_unit
from .words import in_words

MOST = 4_000_000  # voxels that are looked at; of larger maps every second one, third one and so on
CELL = 1.5  # side of the squares in which a voxel hides others, in distances of voxels
# Font sizes: from line to line, more from name to name, between a name and its line, from the begin of a line to what
# is visible, and from a name to the edge; how far letters of the patient's sides reach from there.
LEADING, APART, SPACE, AWAY, EDGE, LETTERS = 1.2, 0.3, 0.35, 1.2, 0.4, 2.0
WIDEST = 0.26  # share of a picture's width; longer names have several lines
MOST_BESIDE = 0.8  # share of a picture's width that names take
VISIBLE = 0.02  # opacity from which a pixel counts
LINE, BALL = 0.2, 0.45  # mm: width of a line, and radius of the ball at its end
CORNERS = 24  # of a ball


def names_of(scene: Scene) -> tuple[Name, ...]:
    """The names of the segments that a scene shows and that have one; none without labels."""
    if scene.labels is None:
        return ()
    named = {one.label: one.name for one in scene.labels.volume.named_labels} | scene.labels.names
    hidden = {label for label, function in scene.labels.functions.items() if function is None}
    shown = sorted(named.keys() - hidden - {BACKGROUND})
    return tuple(Name(in_words(named[label]), label) for label in shown if named[label].strip(" _"))


def find_segments(scene: Scene, labels) -> tuple[dict, tuple[float, float]]:
    """For each segment in the picture the place that its line leads to.

    Parameters
    ----------
    labels : collection of int
        The segments. They hide one another; other parts of the volume hide none.

    Returns
    -------
    places : dict of int to (2,) ndarray
        In pixels from the lower left corner. Segments that are cut away or beside the picture are left out.
    ends : (left, right) of float
        Ends of all of them, in pixels.
    """
    if scene.labels is None:
        return {}, (0.0, 0.0)
    map_of = scene.labels.volume.voxels
    stride = int(np.ceil((map_of.size / MOST) ** (1.0 / 3.0)))
    index = np.argwhere(np.isin(map_of[::stride, ::stride, ::stride], list(labels))) * stride
    numbers, index = map_of[tuple(index.T)], index[:, ::-1].astype(np.float64)
    for clip in scene.clips:
        sides = half_spaces(clip, scene.index_to_world)
        inside = (index @ sides[:, :3].T + sides[:, 3] <= 0.0).all(axis=1)
        kept = ~inside if clip.kind == "box" and clip.keep == "outside" else inside
        numbers, index = numbers[kept], index[kept]
    places, depths = _project(scene, index @ scene.index_to_world[:3, :3].T + scene.index_to_world[:3, 3])
    shown = _is_inside(scene, places, depths)
    if not shown.any():
        return {}, (0.0, 0.0)
    numbers, places, depths = numbers[shown], places[shown], depths[shown]
    long = np.linalg.norm(scene.index_to_world[:3, :3], axis=0).max()
    cell = CELL * stride * long * pixels_per_world_unit(scene, float(depths.mean()))
    return find_places(numbers, places, depths, cell), (places[:, 0].min(), places[:, 0].max())


def _project(scene: Scene, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points of the world, (n, 3), as pixels from the lower left corner, (n, 2), and their depths, (n,)."""
    points = np.column_stack((points, np.ones(len(points))))
    column, row, weight = world_to_pixel(scene.camera, scene.width, scene.height) @ points.T
    depths = points @ depth_row(scene.camera)
    with np.errstate(divide="ignore", invalid="ignore"):  # beside the camera, which ``_is_inside`` leaves out
        return np.column_stack((column / weight, scene.height - row / weight)), depths


def _is_inside(scene: Scene, places: np.ndarray, depths: np.ndarray) -> np.ndarray:
    """Which points the picture shows; an orthographic one shows those behind the camera, too."""
    nearest = 0.0 if scene.camera.type == "PERSP" else -np.inf
    return ((places > 0.0) & (places < (scene.width, scene.height))).all(axis=1) & (depths > nearest)


def find_names(scene: Scene, names) -> tuple[dict, tuple[float, float]]:
    """The places of names, by their keys, and the ends of what they name, as ``find_segments`` returns them."""
    labels = {one.label for one in names if one.point is None}
    places, ends = find_segments(scene, labels) if labels else ({}, (0.0, 0.0))
    points = [one for one in names if one.point is not None]
    if points:
        found, depths = _project(scene, np.array([one.point for one in points], np.float64))
        shown = _is_inside(scene, found, depths)
        across = [*found[shown, 0], *(ends if places else ())]
        places |= {one.key: place for one, place, there in zip(points, found, shown) if there}
        ends = (min(across), max(across)) if across else ends
    return places, ends


def _lines(names, size: float, across: float) -> tuple[dict, float]:
    """The lines of each name by its key, in a picture as wide as ``across``, and the width of the longest."""
    lines = {one.key: wrap(one.text, size, WIDEST * across) for one in names}
    return lines, max((text_width(line, size) for of_one in lines.values() for line in of_one), default=0.0)


def share_beside(names, size: float, across: float) -> float:
    """Share of a picture's width that names take at both sides of what is visible; ``size``: that of the font, mm.

    ``across``: width of the picture, mm.
    """
    beside = _lines(names, size, across)[1] + (SPACE + AWAY + EDGE) * size if names else 0.0
    return min(2.0 * beside / across, MOST_BESIDE)


def name_items(panel: Panel, picture, corner, per_mm: float, size: float, ink, halo, letters: bool) -> list:
    """The names of a panel.

    Parameters
    ----------
    picture : (H, W, 4) ndarray of float32 or None
        Names stand beyond what is visible in it; without it, beyond what they name.
    corner : (x, y) of float
        The picture's upper left corner on the page, mm.
    per_mm : float
        Pixels of the picture per mm.
    size : float
        Font size in mm.
    halo : (3,) tuple of float or None
        Color that sets names and lines off from the picture.
    letters : bool
        Whether letters stand at the middles of the picture's edges.

    Returns
    -------
    list
        Stroke, Fill and Text.

    Raises
    ------
    RleSplatError
        If the picture has no room for so many.
    """
    scene = panel.scene
    places, ends = find_names(scene, panel.names)
    if not places:
        return []
    seen = () if picture is None else np.flatnonzero((picture[..., 3] > VISIBLE).any(axis=0))
    ends = min((*seen[:1], ends[0])) / per_mm, max((*seen[-1:], ends[1])) / per_mm
    places = {key: place / per_mm for key, place in places.items()}
    wide, tall = scene.width / per_mm, scene.height / per_mm
    lines, items = _lines(panel.names, size, wide)[0], []
    high = {key: (LEADING * len(lines[key]) + APART) * size for key in places}
    for column, toward, end, edge in zip(split(places), (-1.0, 1.0), ends, (0.0, wide)):
        if sum(high[key] for key in column) > tall:
            raise RleSplatError(
                f"The picture of a figure has no room for {len(column)} names at one side; hide some segments, make "
                "the font smaller, or the picture higher."
            )
        longest = max((text_width(line, size) for key in column for line in lines[key]), default=0.0)
        nearest = toward * edge - (longest + (SPACE + EDGE) * size)
        x = toward * min(toward * end + AWAY * size, nearest)
        meets = letters and abs(edge - x) < longest + (SPACE + LETTERS) * size
        taken = [(edge, 0.5 * tall)] if meets else []
        heights = spread(column, places, x, 0.0, tall, high, taken)
        for key, y in heights.items():
            items += _line(*(_on_page(corner, tall, at) for at in ((x, y), places[key])), ink, halo)
            at_x, at_y = _on_page(corner, tall, (x + toward * SPACE * size, y))
            for number, line in enumerate(lines[key]):
                below = 0.36 + LEADING * (number - 0.5 * (len(lines[key]) - 1))
                anchor = "end" if toward < 0.0 else "start"
                items.append(Text(at_x, at_y + below * size, line, size, ink, anchor=anchor, halo=halo))
    return items


def _on_page(corner, tall: float, place) -> tuple[float, float]:
    return corner[0] + float(place[0]), corner[1] + tall - float(place[1])


def _line(begin, end, ink, halo) -> list:
    """A line with a ball at its end, set off from the picture."""
    turns = [2.0 * math.pi * n / CORNERS for n in range(CORNERS)]
    items = []
    for color, wider in ((halo, LINE), (ink, 0.0)):
        if color is not None:
            ball = tuple(
                (end[0] + (BALL + 0.5 * wider) * math.cos(a), end[1] + (BALL + 0.5 * wider) * math.sin(a))
                for a in turns
            )
            items += [Stroke((begin, end), LINE + wider, color), Fill(ball, color)]
    return items
