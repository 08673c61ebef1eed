"""From a figure and its pictures to a page: where everything stands, in millimeters."""

import math
from dataclasses import dataclass, field

import numpy as np

from ..classify.presets import PRESETS, preset
from ..effects.ray_mode import OF_VALUES
from ..scene import RleSplatError, Scene, as_background
from ..segment.body import NAMES
from ..segment.label_map import BACKGROUND
from . import scale
from .color_bar import Lines, color_bar
from .directions import NO_BREAK, WORDS, cube, edge_letters, knows_sides, letter_texts, view_name
from .lettering import check_text, text_width, wrap
from .names import name_items
from .page import MM_PER_POINT, Fill, Page, Text, Tile
from .plan import AUTO, GUTTER, MARGIN, OFF, Figure, Panel

LABELS = "abcdefghijklmnopqrstuvwxyz"
BODY_NAMES = {one.label: one.name for one in NAMES}  # those that Hide Table gives
LEADING = 1.35  # from line to line, in font sizes
BAR = 0.7  # mm: thickness of a scale bar
WIDEST_BAR = 85.0  # mm: a color bar for the whole figure
MOST_POINTS = 6  # of an opacity curve that a caption lists
ALIKE = 1e-4  # share of a range up to which Blender's numbers of 32 bits count as those of a preset
CUBE = 2.8  # font sizes: an edge of the cube
LUMINANCE = (0.2126, 0.7152, 0.0722)  # of scene-linear RGB
DARK = 0.179  # luminance below which white lettering has more contrast than black (WCAG 2: (L + 0.05)^2 = 0.05 * 1.05)
NO_SIDES = "It is not known where the patient's sides are"


@dataclass(frozen=True)
class ScaleBar:
    """A scale bar: its length on the page in mm, and its label."""

    length: float
    label: str

    def is_like(self, other) -> bool:
        """Whether another bar, or None, is as long and says the same."""
        return other is not None and other.label == self.label and math.isclose(other.length, self.length, rel_tol=1e-6)


@dataclass(eq=False)
class PageDraft:
    """A page in the making: the figure, how far surfaces of its panels are smoothed for light, its measures in mm, the
    items so far, and sentences for the report."""

    figure: Figure
    smoothed: list = field(default_factory=list)
    items: list = field(default_factory=list)
    remarks: list = field(default_factory=list)

    def __post_init__(self):
        style = self.figure.style
        self.per_mm = style.pixels_per_mm
        self.size = style.font_size * MM_PER_POINT
        self.background = as_background(style.background)
        self.paper = self.background or (1.0, 1.0, 1.0)
        is_dark = np.dot(self.paper, LUMINANCE) < DARK
        self.ink = (1.0, 1.0, 1.0) if is_dark else (0.0, 0.0, 0.0)
        self.halo = None if self.background is None else self.paper
        first = self.figure.panels[0].scene
        self.tile = first.width / self.per_mm, first.height / self.per_mm
        functions = {panel.scene.transfer_function.key for panel in self.figure.panels}
        self.several_functions = len(functions) > 1
        self.shared_bar = None  # the scale bar of all panels, where they have the same

    def snap(self, place: float) -> float:
        """The nearest whole pixel, in mm."""
        return round(place * self.per_mm) / self.per_mm

    def remark(self, sentence: str) -> None:
        """Note a sentence once."""
        if sentence not in self.remarks:
            self.remarks.append(sentence)


def lay_out(figure: Figure, pictures: list, smoothed: list) -> tuple[Page, list[str]]:
    """Place the pictures of a figure on a page, with everything that explains them.

    Parameters
    ----------
    pictures : list of (H, W, 4) ndarray of float32
        Of its panels; scene-linear, premultiplied.
    smoothed : list of float
        How far the surfaces of each are smoothed for light, in the volume's unit of length.

    Returns
    -------
    page : Page
    remarks : list of str
        Sentences on what the figure does not show.

    Raises
    ------
    RleSplatError
        If something that was asked for cannot be shown.
    """
    draft = PageDraft(figure, smoothed)
    check_labels(figure, draft)
    bars = [scale_bar(panel.scene, draft) for panel in figure.panels]
    if len(bars) > 1 and bars[0] is not None and all(map(bars[0].is_like, bars)):
        draft.shared_bar, bars = bars[0], [None] * len(bars)
    y, columns = MARGIN, figure.columns
    for first in range(0, len(figure.panels), columns):
        row = range(first, min(first + columns, len(figure.panels)))
        y = _row(draft, row, pictures, bars, y)
    y = _add_shared_bars(draft, y)
    y = _caption(draft, y)
    height = math.ceil((y + MARGIN) * draft.per_mm)
    page = Page(figure.style.width, height, figure.style.dpi, draft.background, tuple(draft.items))
    return page, draft.remarks


def check_labels(figure: Figure, draft: PageDraft | None = None) -> None:
    """Refuse letters of a patient whose sides are unknown; ``draft`` notes it where they were not asked for."""
    unknown = any(not knows_sides(panel.scene) for panel in figure.panels)
    if not unknown or figure.style.sides == OFF:
        return
    if figure.style.sides != AUTO:
        raise RleSplatError(f"{NO_SIDES}; state the orientation of the volume, or turn the letters of the figure off.")
    if draft is not None:
        draft.remark(f"{NO_SIDES}, so the figure has no letters.")


def scale_bar(scene: Scene, draft: PageDraft) -> ScaleBar | None:
    """The scale bar of a picture; None without one, which ``draft`` notes if it was left to the program."""
    style = draft.figure.style
    if style.scale_bar == OFF:
        return None
    try:
        per_pixel = scale.length_per_pixel(scene, style.scale_depth)
    except RleSplatError as problem:
        if style.scale_bar != AUTO:
            raise
        draft.remark(f"The figure has no scale bar. {problem}")
        return None
    seen = per_pixel * scene.width
    length = scale.round_length(scale.SHARE * seen) if style.scale_bar == AUTO else float(style.scale_bar)
    label = scale.length_text(length, scene.volume.unit)
    if length > seen:
        raise RleSplatError(
            f"A scale bar of {label} is longer than the picture, which shows "
            f"{scale.length_text(seen, scene.volume.unit)}; give a shorter one."
        )
    if scene.camera.type == "PERSP":
        unit = scale.MM_PER_UNIT.get(scene.volume.unit, 1.0)
        away = scale.depth_of(scene, style.scale_depth) * unit / scale.world_units_per_length(scene)
        label += f" at a depth of {scale.length_text(round(away, 1), scene.volume.unit)}"
    return ScaleBar(length / per_pixel / draft.per_mm, label)


# --- the rows of panels -----------------------------------------------------------------------------------------------


def _row(draft: PageDraft, row: range, pictures: list, bars: list, y: float) -> float:
    """Add one row of panels below ``y``; return where it ends."""
    panels, size = draft.figure.panels, draft.size
    wide, tall = draft.tile
    titles = [_title_lines(draft, n) for n in row]
    lines = max(map(len, titles))
    top = draft.snap(y + LEADING * size * lines + (0.35 * size if lines else 0.0))
    strip = max(_strip_lines(draft, n, bars[n]) for n in row)
    below = top + tall + LEADING * size * strip + (0.4 * size if strip else 0.0)
    for place, n in enumerate(row):
        x = draft.snap(MARGIN + place * (wide + draft.snap(GUTTER)))
        for number, line in enumerate(titles[place]):
            _title(draft, n, line, number, x, y + size + LEADING * size * number)
        draft.items.append(Tile(x, top, pictures[n]))
        _sides(draft, panels[n].scene, x, top)
        draft.items += names_in(draft, panels[n], pictures[n], x, top)
        _strip(draft, n, bars[n], x, top + tall, strip)
        if draft.several_functions and draft.figure.style.color_bar:
            _color_bar(draft, panels[n].scene, x, below + 0.3 * size, wide)
    end = below
    if draft.several_functions and draft.figure.style.color_bar:
        end += Lines(0.9 * size).height + 0.5 * size
    return end + (0.8 * GUTTER if row.stop < len(panels) else 0.0)


def _title_lines(draft: PageDraft, n: int) -> list[str]:
    """The lines of a panel's title, at least one where panels have letters."""
    indent = _indent(draft)
    lines = wrap(draft.figure.panels[n].title, draft.size, draft.tile[0] - indent)
    return lines or ([""] if indent else [])


def _indent(draft: PageDraft) -> float:
    """Where a title begins, beside the panel's letter; 0 for a figure of one panel."""
    return 1.7 * draft.size if 1 < len(draft.figure.panels) <= len(LABELS) else 0.0


def _title(draft: PageDraft, n: int, line: str, number: int, x: float, y: float) -> None:
    if _indent(draft) and number == 0:
        draft.items.append(Text(x, y, LABELS[n], 1.15 * draft.size, draft.ink, bold=True))
    if line:
        draft.items.append(Text(x + _indent(draft), y, line, draft.size, draft.ink))


def _sides(draft: PageDraft, scene: Scene, x: float, y: float) -> None:
    """The patient's sides in a picture."""
    style, (wide, tall) = draft.figure.style, draft.tile
    if style.sides == OFF or not knows_sides(scene):
        return
    if style.sides == "cube":
        side = CUBE * draft.size
        draft.items += cube(scene, x + wide - 0.9 * side, y + 0.9 * side, side, draft.size)
        return
    draft.items += letter_texts(edge_letters(scene), x, y, wide, tall, draft.size, draft.ink, draft.halo)


def names_in(draft: PageDraft, panel: Panel, picture, x: float, y: float) -> list:
    """The names in a picture whose corner is (x, y); RleSplatError if there is no room for them."""
    letters = draft.figure.style.sides not in (OFF, "cube") and knows_sides(panel.scene)
    return name_items(panel, picture, (x, y), draft.per_mm, draft.size, draft.ink, draft.halo, letters)


def _window_text(draft: PageDraft, n: int) -> str:
    """Window and level of a panel that shows values, where panels differ in them."""
    scene = draft.figure.panels[n].scene
    if not draft.several_functions or scene.mode not in OF_VALUES:
        return ""
    window, level, unit = window_of(scene)
    return f"W {window} L {level} {unit}".rstrip()


def window_of(scene: Scene) -> tuple[str, str, str]:
    """Window, level and unit of the values of a scene's transfer function, as texts."""
    low, high = scene.transfer_function.span
    texts = (f"{value:.5g}".replace("-", "−") for value in (high - low, 0.5 * (low + high)))
    return *texts, scene.volume.value_unit or ""


def _strip_lines(draft: PageDraft, n: int, bar: ScaleBar | None) -> int:
    """Lines that scale bar and window need below a picture."""
    window = _window_text(draft, n)
    if bar is None or not window:
        return int(bar is not None or bool(window))
    width = bar.length + 2.0 * draft.size + sum(text_width(text, draft.size) for text in (bar.label, window))
    return 1 if width <= draft.tile[0] else 2


def _strip(draft: PageDraft, n: int, bar: ScaleBar | None, x: float, y: float, lines: int) -> None:
    """Scale bar, and window and level, below a picture that ends at ``y``."""
    size, window = draft.size, _window_text(draft, n)
    if bar is not None:
        _scale_bar(draft, bar, x, y, bar.label)
    if window:
        baseline = y + 1.31 * size + (lines - 1) * LEADING * size
        draft.items.append(Text(x + draft.tile[0], baseline, window, size, draft.ink, anchor="end"))


def _scale_bar(draft: PageDraft, bar: ScaleBar, x: float, y: float, label: str) -> None:
    size, middle = draft.size, y + 0.95 * draft.size
    corners = ((x, middle - 0.5 * BAR), (x + bar.length, middle - 0.5 * BAR),
               (x + bar.length, middle + 0.5 * BAR), (x, middle + 0.5 * BAR))  # fmt: skip
    draft.items.append(Fill(corners, draft.ink))
    draft.items.append(Text(x + bar.length + 0.6 * size, middle + 0.36 * size, label, size, draft.ink))


# --- color bars and caption -------------------------------------------------------------------------------------------


def _color_bar(draft: PageDraft, scene: Scene, x: float, y: float, width: float) -> None:
    function, volume = scene.transfer_function, scene.volume
    distance = function.opacity_unit_distance or float(volume.spacing.min())
    length = None if scene.mode in OF_VALUES else f"{distance:.3g} {volume.unit}"
    draft.items += color_bar(
        function, length, volume.value_unit, (x, y, width), 0.9 * draft.size, draft.per_mm, draft.ink
    )
    if scene.channels or (scene.labels is not None and any(scene.labels.functions.values())):
        draft.remark("The color bar is that of the volume; labels and channels have further colors.")


def _add_shared_bars(draft: PageDraft, y: float) -> float:
    """Add the scale bar and the color bar that all panels share; return where they end."""
    if draft.shared_bar is not None:
        _scale_bar(draft, draft.shared_bar, MARGIN, y + 0.3 * draft.size, f"{draft.shared_bar.label}, all panels")
        y += (LEADING + 0.7) * draft.size
    if draft.several_functions or not draft.figure.style.color_bar:
        return y
    width = min(draft.figure.style.width / draft.per_mm - 2.0 * MARGIN, WIDEST_BAR)
    _color_bar(draft, draft.figure.panels[0].scene, MARGIN, y + 0.6 * draft.size, width)
    return y + 0.8 * draft.size + Lines(0.9 * draft.size).height


def _caption(draft: PageDraft, y: float) -> float:
    """Add the caption; return where it ends."""
    caption = draft.figure.style.caption
    text = automatic_caption(draft) if caption is None else caption
    width = draft.figure.style.width / draft.per_mm - 2.0 * MARGIN
    lines = wrap(text, draft.size, width)
    y += 0.7 * draft.size if lines else 0.0
    for number, line in enumerate(lines):
        draft.items.append(Text(MARGIN, y + draft.size * (1.0 + LEADING * number), line, draft.size, draft.ink))
    return y + LEADING * draft.size * len(lines)


def automatic_caption(draft: PageDraft) -> str:
    """What is seen: window and level or transfer function, voxels, view, projection, letters of the patient's sides."""
    scenes = [panel.scene for panel in draft.figure.panels]
    first = scenes[0]
    sentences = []
    shows_values = any(scene.mode in OF_VALUES for scene in scenes)
    if draft.several_functions:
        sentences += ["W window, L level."] if shows_values else []
    elif shows_values:
        window, level, unit = window_of(first)
        sentences.append(f"Window {window} {unit}".rstrip() + f", level {level} {unit}".rstrip() + ".")
    elif first.transfer_function.name:
        sentences.append(f"Transfer function {_function_words(first)}.")
    for words in (_voxel_words, _cut_words, _hidden_words):
        sentences += _sentence_of_panels([words(scene) for scene in scenes])
    sentences += _sentence_of_panels(list(map(_smoothing_words, scenes, draft.smoothed)))
    kinds = {"ORTHO": "Orthographic", "PERSP": "Perspective"}
    found = list(dict.fromkeys(kinds[scene.camera.type] for scene in scenes))
    views = {view_name(scene) for scene in scenes}
    view = views.pop() if len(views) == 1 else ""  # several views have their titles
    projection = f"{' and '.join(found)} projection."
    sentences.append(f"{view}, {projection.lower()}" if view else projection.capitalize())
    letters = _letters_used(draft, scenes)
    if letters:
        named = (f"{letter}{NO_BREAK}{WORDS[letter]}" for letter in WORDS if letter in letters)
        sentences.append(", ".join(named) + ".")
    text = " ".join(sentences)
    return check_text(text, "The figure's caption")


def _sentence_of_panels(texts: list) -> list[str]:
    """A sentence of what all panels have, or of which has what; none where no panel has anything."""
    found: dict[str, list[str]] = {}
    for n, text in enumerate(texts):
        found.setdefault(text, []).append(LABELS[n] if len(texts) <= len(LABELS) else str(n + 1))
    if len(found) == 1:
        return [f"{text[:1].upper()}{text[1:]}." for text in found if text]
    parts = "; ".join(f"({', '.join(panels)}) {text}" for text, panels in found.items() if text)
    return [f"{parts}."] if parts else []


def _voxel_words(scene: Scene) -> str:
    counts = " × ".join(map(str, scene.volume.shape_xyz))
    sides = " × ".join(f"{side:.3g}" for side in np.round(scene.volume.spacing, 6))
    return f"{counts} voxels of {sides}{NO_BREAK}{scene.volume.unit}"


def _cut_words(scene: Scene) -> str:
    kinds = [clip.kind for clip in scene.clips]
    planes, boxes = kinds.count("plane"), kinds.count("box")
    counted = (planes, "plane" if planes == 1 else "planes"), (boxes, "box" if boxes == 1 else "boxes")
    return f"cut by {' and '.join(f'{number} {word}' for number, word in counted if number)}" if kinds else ""


def _smoothing_words(scene: Scene, length: float) -> str:
    return f"surfaces smoothed by {length:.3g}{NO_BREAK}{scene.volume.unit} for light" if length else ""


def _hidden_words(scene: Scene) -> str:
    """How many segments are hidden, and whether the background is; "" where nothing is.

    Without the names of segments, which may say who the patient is, but for those that Hide Table gives.
    """
    if scene.labels is None:
        return ""
    hidden = {label for label, function in scene.labels.functions.items() if function is None}
    count = len(hidden - {BACKGROUND})
    segments = f"{count} segment{'s' * (count > 1)}" if count else ""
    named = {one.label: one.name for one in scene.labels.volume.named_labels} | scene.labels.names
    outside = "what lies beside the body" if named == BODY_NAMES else "what is outside all segments"
    return "hidden: " * bool(hidden) + " and ".join(filter(None, (outside * (BACKGROUND in hidden), segments)))


def _function_words(scene: Scene) -> str:
    """The transfer function's name and, if it is that of a preset, in what it differs from it."""
    function, volume = scene.transfer_function, scene.volume
    named = next((name for name, row in PRESETS.items() if row.label == function.name), None)
    if named is None:
        return function.name
    own, unit = preset(named), f" {function.unit}" if function.unit else ""
    (low, high), (first, last) = function.span, own.span
    moved = own.remapped(low, high, unit=function.unit)
    ends = np.unique([point[0] for one in (function, moved) for point in (*one.opacity, *one.color)])
    apart = np.diff(ends) > ALIKE * (high - low)  # a step may lie a rounding beside the other's
    values = ends[:-1][apart] + np.diff(ends)[apart] * [[0.25], [0.75]]
    is_alike = np.allclose(function.table(values), moved.table(values), atol=ALIKE)
    words = []
    if not is_alike or function.gradient_opacity != moved.gradient_opacity:
        words.append("modified" + _opacity_words(function.opacity, unit))
    elif own.unit != function.unit or not math.isclose(high - low, last - first, rel_tol=ALIKE):
        words.append(f"mapped to {low:.4g} to {high:.4g}{unit}")
    elif not math.isclose(low, first, abs_tol=ALIKE * (last - first)):
        words.append(f"shifted by {low - first:.4g}{unit}")
    if function.opacity_unit_distance != own.opacity_unit_distance:
        distance = function.opacity_unit_distance or float(volume.spacing.min())
        words.append(f"opacity unit distance {distance:.3g} {volume.unit}")
    return ", ".join((function.name, *(word.replace("-", "−") for word in words)))


def _opacity_words(points, unit: str) -> str:
    """The points of an opacity curve from where it rises, as ": opacity 0 at 270, 0.9 at 800 HU"; "" of many."""
    rising = [point for point, after in zip(points, (*points[1:], None)) if after is None or point[1] or after[1]]
    listed = ", ".join(f"{alpha:.2g} at {value:.4g}" for value, alpha in rising)
    return f": opacity {listed}{unit}" if len(rising) <= MOST_POINTS else ""


def _letters_used(draft: PageDraft, scenes: list) -> set:
    if draft.figure.style.sides == OFF or not all(map(knows_sides, scenes)):
        return set()
    if draft.figure.style.sides == "cube":
        return set(WORDS)
    return {letter for scene in scenes for letter in "".join(edge_letters(scene).values())}
