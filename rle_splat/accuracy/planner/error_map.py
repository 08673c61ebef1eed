"""The error of a picture, pixel by pixel."""

import numpy as np

from ...pipeline.stage_cache import StageCache
from ...scene import Quality, Scene
from ..probes import probe_errors
from .checks import measurable_scene
from .probe_errors import true_pixel_steps
from .session import picture_steps


def error_map_steps(scene: Scene, quality: Quality, *, step: int = 1, cache: StageCache | None = None):
    """Measure the error of a scene's picture in blocks of ``step`` x ``step`` pixels.  Generator of Progress.

    Returns
    -------
    errors : (h, w) float32
        Levels: the largest error of any channel at the middle pixel of each block.  A block that the picture's edge
        cuts off before its middle is left out.
    report : dict
        The picture's report; its ``error`` holds the largest error, RMSE, truth, probes and step.

    Raises
    ------
    RleSplatError
        As ``checks.measurable_scene``.
    """
    scene = measurable_scene(scene, quality)
    cache = StageCache() if cache is None else cache
    rendering = yield from picture_steps(scene, quality, cache, 0.0, 0.3, f"Rendering {quality.name}")
    first = min(step // 2, scene.height - 1, scene.width - 1)
    rows, columns = np.mgrid[first : scene.height : step, first : scene.width : step]
    name = rendering.report["error"]["truth"]
    true = yield from true_pixel_steps(scene, name, columns.ravel() + 0.5, rows.ravel() + 0.5, 0.3, 1.0)
    errors = probe_errors(rendering.rgba[rows, columns].reshape(-1, 4), true)
    report = dict(rendering.report)
    report["error"] = {
        **report["error"], "measured": float(errors.max()), "rmse": float(np.sqrt((errors**2).mean())),
        "truth": name, "probes": len(errors), "step": step,
    }  # fmt: skip
    return errors.reshape(rows.shape).astype(np.float32), report
