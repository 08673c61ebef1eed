"""Makes a figure: renders its panels and lays them out."""

from dataclasses import dataclass

from ..pipeline.render import render_steps
from ..pipeline.stage_cache import StageCache
from ..runtime.steps import Progress, map_steps
from ..scene import Quality, Rendering
from .layout import PageDraft, automatic_caption, check_labels, lay_out, scale_bar
from .lettering import check_text
from .page import Page
from .plan import Figure

LAYOUT = 0.97  # share of the work until the page is laid out


@dataclass(frozen=True, eq=False)
class MadeFigure:
    """A figure that was made.

    Attributes
    ----------
    renderings : tuple of Rendering
        Of its panels.
    remarks : tuple of str
        What the figure does not show, and what its pictures are worth a remark for.
    """

    figure: Figure
    page: Page
    renderings: tuple[Rendering, ...]
    remarks: tuple[str, ...]


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
    page, remarks = lay_out(figure, [rendering.rgba for rendering in renderings])
    said = [remark for rendering in renderings for remark in rendering.report["remarks"]]
    return MadeFigure(figure, page, tuple(renderings), tuple(dict.fromkeys((*remarks, *said))))


def check_figure(figure: Figure) -> None:
    """Refuse a figure that asks for a scale bar, letters or a lettering that it cannot have."""
    draft = PageDraft(figure)
    check_labels(figure)
    for panel in figure.panels:
        scale_bar(panel.scene, draft)
        check_text(panel.scene.volume.unit, "The unit of lengths")
        check_text(panel.scene.volume.value_unit or "", "The unit of the values")
    if figure.style.caption is None:
        automatic_caption(draft)


def _panel_steps(scene, quality: Quality, cache: StageCache, n: int, count: int):
    """Generator of Progress: the Rendering of panel ``n`` of ``count``."""
    which = f"Panel {n + 1} of {count}: " if count > 1 else ""

    def show_step(step: Progress) -> Progress:
        return Progress(LAYOUT * (n + step.fraction) / count, which + step.message)

    return (yield from map_steps(render_steps(scene, quality, cache), show_step))
