"""Makes a figure: renders its panels and lays them out."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..pipeline.render import render_steps
from ..pipeline.scalar_light import smoothness_of
from ..pipeline.stage_cache import StageCache
from ..runtime.steps import Progress, drain, map_steps
from ..scene import Quality, QualityName, Rendering, RleSplatError, Scene
from ..scene.png import png_bytes
from ..scene.quality import as_quality
from .framing import frame_steps
from .layout import PageDraft, automatic_caption, check_labels, lay_out, names_in, scale_bar
from .lettering import check_text
from .names import names_of
from .page import Page
from .plan import Figure, FigureStyle, Panel, tile_size
from .raster import draw

LAYOUT = 0.97  # share of the work until the page is laid out
FINER = 2  # rendered pixels along each side of a pixel of the figure: edges are smooth in their mean
MOST_FINER = 1 << 25  # rendered pixels of a panel; larger ones are printed so finely that nobody sees steps


@dataclass(frozen=True, eq=False)
class MadeFigure:
    """A figure that was made.

    Attributes
    ----------
    renderings : tuple of Rendering
        Of its panels, most of them with twice as many pixels along each side as on the page.
    remarks : tuple of str
        What the figure does not show, and what its pictures are worth a remark for.
    """

    figure: Figure
    page: Page
    renderings: tuple[Rendering, ...]
    remarks: tuple[str, ...]

    def _repr_png_(self) -> bytes:
        """The page in a notebook."""
        return png_bytes(draw(self.page), self.page.dpi, self.page.background)

    def __repr__(self) -> str:
        count = len(self.renderings)
        return f"<MadeFigure of {count} panel{'s' * (count > 1)}, {self.page.width} x {self.page.height} pixels>"


def make_figure(
    scenes: Scene | Sequence[Scene], titles: Sequence[str] = (), style: FigureStyle | None = None,
    quality: Quality | QualityName | None = None, *, fill: bool = True, names: bool = False,
) -> MadeFigure:  # fmt: skip
    """Make a figure for print: pictures with letters, scale bar, color bar and caption.

    Parameters
    ----------
    scenes : Scene or sequence of Scene
        One for each panel. The style decides on the sizes of the pictures; those of the scenes do not count.
    titles : sequence of str
        One for each panel, or none.
    style : FigureStyle, optional
        Sizes, colors and lettering. Left out, ``FigureStyle()``.
    quality : Quality or str, optional
        Of the pictures, as ``render`` takes it. Left out, "standard".
    fill : bool
        Whether orthographic views are moved and get one scale at which what is visible fills the pictures; else they
        are those of the cameras.
    names : bool
        Whether the names of the segments that are shown are written beside the pictures, with lines.

    Returns
    -------
    MadeFigure
        For ``write_figure``; notebooks show it.

    Raises
    ------
    RleSplatError
        If a panel cannot be rendered, a text has no letters, or something that was asked for cannot be shown.
    """
    scenes = [scenes] if isinstance(scenes, Scene) else list(scenes)
    style = FigureStyle() if style is None else style
    titles = list(titles) or [""] * len(scenes)
    if len(titles) != len(scenes):
        raise RleSplatError(f"There are {len(titles)} titles for {len(scenes)} scenes; give one for each, or none.")
    pixels = dict(zip(("width", "height"), tile_size(style, max(len(scenes), 1))))
    panels = tuple(
        Panel(replace(scene, **pixels), title, names_of(scene) if names else ()) for scene, title in zip(scenes, titles)
    )
    figure, cache = Figure(panels, style), StageCache()
    if fill:
        figure = drain(frame_steps(figure, cache))
    return drain(figure_steps(figure, [as_quality(quality)] * len(panels), cache))


def figure_steps(figure: Figure, qualities, cache: StageCache | None = None):
    """Generator of Progress: render a figure's panels and lay them out; return the MadeFigure.

    Parameters
    ----------
    qualities : sequence of Quality
        One for each panel.
    cache : StageCache, optional
        Results of stages, which panels have in common.

    Raises
    ------
    RleSplatError
        If a panel cannot be rendered, or something that was asked for cannot be shown: before anything is rendered.
    """
    check_figure(figure)
    cache = StageCache() if cache is None else cache
    renderings, count = [], len(figure.panels)
    for n, (panel, quality) in enumerate(zip(figure.panels, qualities, strict=True)):
        renderings.append((yield from _panel_steps(panel.scene, quality, cache, n, count)))
    yield Progress(LAYOUT, "Laying out the figure")
    page, remarks = lay_out(
        figure, [_shrink(one.rgba, _times(panel.scene)) for one, panel in zip(renderings, figure.panels)],
        [_smoothed(panel.scene, one.report) for one, panel in zip(renderings, figure.panels)],
    )  # fmt: skip
    said = [remark for rendering in renderings for remark in rendering.report["remarks"]]
    return MadeFigure(figure, page, tuple(renderings), tuple(dict.fromkeys((*remarks, *said))))


def check_figure(figure: Figure) -> None:
    """Refuse a figure that asks for a scale bar, letters or a lettering that it cannot have."""
    draft = PageDraft(figure)
    check_labels(figure)
    for panel in figure.panels:
        scale_bar(panel.scene, draft)
        names_in(draft, panel, None, 0.0, 0.0)
        check_text(panel.scene.volume.unit, "The unit of lengths")
        check_text(panel.scene.volume.value_unit or "", "The unit of the values")
    if figure.style.caption is None:
        automatic_caption(draft)


def _panel_steps(scene, quality: Quality, cache: StageCache, n: int, count: int):
    """Generator of Progress: the Rendering of panel ``n`` of ``count``."""
    which = f"Panel {n + 1} of {count}: " if count > 1 else ""

    def show_step(step: Progress) -> Progress:
        return Progress(LAYOUT * (n + step.fraction) / count, which + step.message)

    times = _times(scene)
    smooth = scene.antialias and times == 1  # the mean of finer pixels is smooth already
    finer = replace(scene, width=times * scene.width, height=times * scene.height, antialias=smooth)
    return (yield from map_steps(render_steps(finer, quality, cache=cache), show_step))


def _smoothed(scene, report: dict) -> float:
    """How far a picture's surfaces are smoothed for light, in the volume's unit; 0 where they are not."""
    shaded = any(effect["name"] == "shading" and effect["on"] for effect in report["effects"])
    return smoothness_of(scene) if shaded and report["plan"]["classification"] == "post" else 0.0


def _times(scene) -> int:
    """How many pixels are rendered along each side of a pixel of a panel."""
    of_pixels = scene.crop is not None or scene.ray_ends is not None
    return 1 if of_pixels or FINER**2 * scene.width * scene.height > MOST_FINER else FINER


def _shrink(rgba: np.ndarray, times: int) -> np.ndarray:
    """The means of squares of so many pixels along each side."""
    height, width = rgba.shape[:2]
    return rgba.reshape(height // times, times, width // times, times, 4).mean(axis=(1, 3))
