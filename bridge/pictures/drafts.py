"""Drafts: a quick picture of the same scene before the picture itself, made from the same results of stages."""

import math
from dataclasses import dataclass, replace

from ...rle_splat.pipeline.render import render_steps
from ...rle_splat.pipeline.stage_cache import StageCache
from ...rle_splat.runtime.steps import FRAME, rescale
from ...rle_splat.scene import Quality, Rendering, Scene

PRESET = "draft"
QUICK = 30.0  # milliseconds: a picture whose draft is splatted and warped sooner is there at once itself
SHARE = 0.5  # of the progress bar for the draft, which classifies, lights and encodes
TABLE_BYTES = 8  # for each voxel of a scan, of what both pictures need: the stage cache has to hold it


@dataclass(frozen=True, eq=False)
class Draft:
    """A step of ``drafted_steps``: the draft, to be shown."""

    rendering: Rendering


def draft_of(quality: Quality) -> Quality:
    """The quality of drafts: the preset's, with what a scene sets beside presets."""
    if quality.model != "extinction":  # the paper's own model has no presets
        return quality
    return Quality.preset(PRESET, classification=quality.classification, record=quality.record, threads=quality.threads)


def drafted_steps(plain: Scene, quality: Quality, cache: StageCache, *, refuse_empty_view: bool = True):
    """As ``render_steps``, with a draft first where the picture takes a while.

    Parameters
    ----------
    cache : StageCache
        Passes what is classified, lit and encoded for the draft on to the picture.

    Yields
    ------
    Progress or Draft
        At most one Draft.

    Returns
    -------
    Rendering
        That of ``render_steps`` to the bit. The times in its report include those of the draft: its splat, warp and
        rays as "draft".
    """
    quick = draft_of(quality)
    if quick == quality or TABLE_BYTES * math.prod(plain.volume.shape_xyz) > cache.most_bytes:
        return (yield from render_steps(plain, quality, cache=cache, refuse_empty_view=refuse_empty_view))
    draft = yield from rescale(render_steps(plain, quick, cache=cache, refuse_empty_view=refuse_empty_view), 0.0, SHARE)
    spent = draft.report["stages_ms"]
    of_frame = sum(spent[stage] for stage in FRAME)
    if of_frame > QUICK:
        yield Draft(draft)
    rendering = yield from rescale(
        render_steps(plain, quality, cache=cache, refuse_empty_view=refuse_empty_view), SHARE, 1.0
    )
    own = dict(rendering.report["stages_ms"])
    total = own.pop("total") + spent["total"]
    stages = {stage: ms + (0.0 if stage in FRAME else spent[stage]) for stage, ms in own.items()}
    stages |= {"draft": of_frame, "total": total}
    kernels = sorted({*rendering.report["kernels"], *draft.report["kernels"]})
    return replace(rendering, report={**rendering.report, "stages_ms": stages, "kernels": kernels})
