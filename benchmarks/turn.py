"""A full turn around a volume: does the picture pop where the principal axis switches?

Each frame is compared with the previous one, and alpha is summed over the picture.  Near the first switch the same
frame is drawn along both principal axes, and the two are compared with each other and, at probe pixels, with the truth.
Small steps are compared with and without fading between the axes.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

import numpy as np

from rle_splat.accuracy.metrics import LEVEL, difference
from rle_splat.accuracy.probes import draw_pixels
from rle_splat.accuracy.truths import truth
from rle_splat.classify.transfer_function import TransferFunction
from rle_splat.pipeline.render import render
from rle_splat.pipeline.stage_cache import StageCache
from rle_splat.runtime.jit import compiled
from rle_splat.scene import DEFAULT_CLASSIFICATION, Quality, RleSplatError, truth_of
from rle_splat.view.eye import index_view
from rle_splat.view.principal_axis import axis_shares, dominant_axis
from rle_splat.volume.volume import Volume

from .frames import view_scene
from .phantoms import smooth_shell
from .plots import IMAGES, turn_plot
from .run import Run, make_parser
from .scenes import REAL, scenes

SMOOTH = "smooth"
SMOOTH_SIDE = 96
BAND = 2.5  # degrees on either side of the switch, slightly more than the band where both axes are drawn
BAND_STEP = 0.25
PROBES = 128


def smooth(n: int = SMOOTH_SIDE) -> tuple[Volume, TransferFunction]:
    """A smooth Gaussian shell whose values are its opacities."""
    color = ((0.0, 0.9, 0.5, 0.2), (0.4, 0.3, 0.7, 0.9))
    return Volume(smooth_shell(n), np.eye(4), name=SMOOTH), TransferFunction(
        SMOOTH, None, ((0.0, 0.0), (1.0, 1.0)), color, 1.0, None
    )


class Turn:
    """Orthographic, unshaded pictures of one volume at an elevation in degrees, optionally along a given axis."""

    def __init__(self, volume, tf, quality: Quality, size: int, elevation: float):
        self._volume, self._tf, self._size, self._elevation = volume, tf, size, elevation
        self._quality, self._kept = quality, StageCache()

    def _scene(self, azimuth: float):
        return view_scene(self._volume, self._tf, (azimuth, self._elevation), self._size, shaded=False)

    def axes(self, azimuth: float) -> list[int]:
        """Principal axes sorted by the rays' speed along them, the renderer's choice first."""
        scene = self._scene(azimuth)
        direction = -index_view(scene.camera, scene.index_to_world, scene.width, scene.height).eye[:3]
        chosen = int(dominant_axis(direction)[0])
        return [chosen, *(int(a) for a in np.argsort(-np.abs(direction), kind="stable") if a != chosen)]

    def switch(self, after: float, before: float) -> float:
        """The azimuth in degrees, between two others, at which the principal axis changes, by bisection."""
        first = self.axes(after)[0]
        for _ in range(40):
            middle = 0.5 * (after + before)
            after, before = (middle, before) if self.axes(middle)[0] == first else (after, middle)
        return 0.5 * (after + before)

    def picture(self, azimuth: float, axis: int | None = None, fade: float | None = None) -> np.ndarray:
        """(H, W, 4) float32 premultiplied: the usual picture, or one along ``axis`` only, or with ``fade`` degrees."""
        quality = self._quality if fade is None else replace(self._quality, axis_fade=fade)

        def alone(view, band):
            (sign,) = (sign for one, sign, _ in axis_shares(view, 45.0) if one == axis)
            return [(axis, sign, 1.0)]

        with patch("rle_splat.pipeline.views.axis_shares", axis_shares if axis is None else alone):
            return render(self._scene(azimuth), quality, cache=self._kept).rgba

    def round(self, step: float) -> list[dict]:
        """JSON-ready, one row per frame: difference in levels from the previous frame, alpha, principal axis."""
        rows, before, axis_before = [], None, None
        for azimuth in np.arange(0.0, 360.0 + 0.5 * step, step):
            axis = self.axes(azimuth)[0]
            picture = self.picture(azimuth)
            change = difference(picture, picture if before is None else before)
            rows.append({
                "azimuth": float(azimuth), "axis": axis, "switched": axis_before not in (None, axis),
                "rmse": change.rmse, "largest": change.largest, "alpha": float(picture[..., 3].sum(dtype=np.float64)),
            })  # fmt: skip
            before, axis_before = picture, axis
        return rows[1:]

    def both_axes(self, azimuth: float, probes: int) -> dict:
        """JSON-ready: the difference in levels of one frame along its two fastest axes, and the error of each."""
        first, second = self.axes(azimuth)[:2]
        pictures = [self.picture(azimuth, axis) for axis in (first, second)]
        apart = difference(pictures[0], pictures[1])
        alpha = difference(pictures[0][..., 3], pictures[1][..., 3])
        scene = self._scene(azimuth)
        columns, rows = draw_pixels(scene.width, scene.height, probes, 0)
        true, _ = truth(scene, truth_of(self._quality), pixels=(columns + 0.5, rows + 0.5))
        errors = [np.abs(picture[rows, columns] - true).max() / LEVEL for picture in pictures]
        steps = [
            difference(*(self.picture(azimuth + side, fade=fade) for side in (-0.5 * BAND_STEP, 0.5 * BAND_STEP)))
            for fade in (None, 0.0)
        ]
        return {
            "azimuth": float(azimuth), "axes": [first, second], "rmse": apart.rmse, "largest": apart.largest,
            "alpha_largest": alpha.largest, "true_largest": float(errors[0]), "other_largest": float(errors[1]),
            "step_faded": steps[0].largest, "step_switched": steps[1].largest,
        }  # fmt: skip


def summary(turn, near, step: float) -> list[str]:
    """The results as sentences."""
    at_switch = [row for row in turn if row["switched"]]
    elsewhere = [row for row in turn if not row["switched"]]
    most = max(near, key=lambda row: row["largest"])
    alpha = np.array([row["alpha"] for row in turn])
    jumps = np.abs(np.diff(alpha, prepend=alpha[-1])) / alpha.mean()
    switched = np.array([row["switched"] for row in turn])
    lines = [f"{len(turn)} frames, {step:g} degrees apart; the principal axis switches {len(at_switch)} times."]
    if at_switch and elsewhere:
        lines += [
            f"Largest difference from the frame before: {max(r['largest'] for r in at_switch):.2f} levels where it "
            f"switches, {max(r['largest'] for r in elsewhere):.2f} elsewhere (RMSE "
            f"{max(r['rmse'] for r in at_switch):.3f} and {max(r['rmse'] for r in elsewhere):.3f}).",
            f"Alpha of the picture changes by at most {jumps[switched].max():.3%} where the axis switches, "
            f"{jumps[~switched].max():.3%} elsewhere.",
        ]
    lines.append(
        f"The same frame from both axes within {BAND:g} degrees of a switch: at most {most['largest']:.2f} levels "
        f"apart (at {most['azimuth']:g} degrees), RMSE {max(row['rmse'] for row in near):.3f}, alpha "
        f"{max(row['alpha_largest'] for row in near):.2f}; from the reference at most "
        f"{max(row['true_largest'] for row in near):.2f} and {max(row['other_largest'] for row in near):.2f}."
    )
    lines.append(
        f"Steps of {BAND_STEP:g} degrees there: at most {max(row['step_faded'] for row in near):.2f} levels with the "
        f"axes faded into each other, {max(row['step_switched'] for row in near):.2f} with a switch."
    )
    return lines


def main(arguments) -> int:
    parser = make_parser(
        "dev.py bench turn", __doc__, volume={"nargs": None, "choices": (SMOOTH, "shells", *REAL), "default": SMOOTH},
        quality={"nargs": None, "default": "standard"}, classification=DEFAULT_CLASSIFICATION, size=256, threads=0,
        probes=PROBES,
    )  # fmt: skip
    parser.add_argument("--elevation", type=float, default=20.0)
    parser.add_argument("--step", type=float, default=1.0, help="degrees")
    parser.add_argument("--image", type=Path, default=IMAGES / "turn.png", help="the plot")
    parser.add_argument("--no-image", action="store_true")
    options = parser.parse_args(arguments)
    if options.volume == SMOOTH:
        volume, tf = smooth()
    else:
        volume, tf = next(((v, f) for _, v, f in scenes([options.volume])), (None, None))
        if volume is None:
            raise RleSplatError(f"The scan {options.volume} is missing; choose {SMOOTH} or shells.")
    quality = Quality.preset(options.quality, options.classification, threads=options.threads)
    if not compiled():
        print("This takes very long without numba.")
    run = Run("turn", arguments, options.threads)
    turn = Turn(volume, tf, quality, options.size, options.elevation)
    frames = turn.round(options.step)
    switched = next((row["azimuth"] for row in frames if row["switched"]), 45.0 + 0.5 * options.step)
    switch = turn.switch(switched - options.step, switched)
    near = [turn.both_axes(a, options.probes) for a in np.arange(switch - BAND, switch + BAND + 1e-9, BAND_STEP)]
    what = f"{options.volume}, {options.classification}, {options.quality}"
    print(f"{what}, elevation {options.elevation:g}, {options.size} x {options.size}")
    print("\n".join(summary(frames, near, options.step)))
    run.keep(turn=frames, both_axes=near)
    if not options.no_image:
        print(turn_plot(frames, near, options.image))
    return 0
