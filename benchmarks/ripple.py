"""How evenly light lies on a ball and an ellipsoid: by each quality, and by the reference.

Ripple is the range from 1 to 99 % of brightness over a polynomial of the surface's normal, in percent, where n.l > 0.5
and n.e > 0.3: what voxels and sheets add to a smooth surface.  Values fall from 1 to 0 over some voxels across it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rle_splat.classify.transfer_function import Shade, TransferFunction
from rle_splat.pipeline.render import render
from rle_splat.scene import Light, Quality, Scene
from rle_splat.view.turntable import turntable
from rle_splat.volume.volume import Volume

from .lamps import shining
from .light import true_colors
from .run import Run, make_parser

VIEW, SIZE, SIDE, PROBES = (35, 25), 400, 96, 4000
BODIES = {"ball": (30.0, 30.0, 30.0), "ellipsoid": (40.0, 30.0, 20.0)}  # half axes, voxels
OPACITIES = {"step": ((0.5, 0.0), (0.5, 0.8)), "ramp": ((0.125, 0.0), (0.875, 0.8))}
ALONG = (0.3, -0.4, -(0.75**0.5))  # where the sun shines to, in the camera's axes: 30 degrees from the view
LIGHTS = {
    "headlight": dict(headlight=True),
    "sun, no shadows": dict(headlight=False, volume_shadows=False),
    "sun": dict(headlight=False, volume_shadows=True),
}
DEGREE = 5  # of the polynomial


def body(half_axes, edge: float) -> Volume:
    """A body in the middle of a cube, whose values fall over ``edge`` voxels."""
    place = np.moveaxis(np.indices((SIDE,) * 3)[::-1], 0, -1) - 0.5 * (SIDE - 1)
    across = np.sqrt((place**2 / np.square(half_axes)).sum(axis=-1))
    slope = np.sqrt((place**2 / np.power(half_axes, 4)).sum(axis=-1))
    distance = across * (across - 1.0) / np.maximum(slope, 1e-9)
    return Volume(np.clip(0.5 - distance / edge, 0.0, 1.0).astype(np.float32), np.eye(4))


def lit_scene(volume: Volume, opacity: str, light: str) -> Scene:
    """The body, matt and white, under one of LIGHTS."""
    matt = Shade(0.0, 1.0, 0.0, 1.0)
    function = TransferFunction(opacity, None, OPACITIES[opacity], ((0.0, 1.0, 1.0, 1.0),), 1.0, matt)
    camera, matrix = turntable(volume, *VIEW, perspective=False)
    scene = Scene(volume, function, camera, SIZE, SIZE, matrix, **LIGHTS[light])
    if scene.headlight:
        return scene
    return replace(scene, lights=(Light("SUN", energy=3.0, matrix_world=shining(camera.matrix_world[:3, :3] @ ALONG)),))


def normals_at(scene: Scene, half_axes) -> np.ndarray:
    """(H, W, 3) unit normals in world space where the eye meets the body; NaN beside it."""
    matrix, index = scene.camera.matrix_world, np.linalg.inv(scene.index_to_world)
    across = (np.arange(SIZE) + 0.5 - 0.5 * SIZE) * scene.camera.ortho_scale / SIZE
    columns, rows = np.meshgrid(across, -across)
    start = matrix[:3, 3] + columns[..., None] * matrix[:3, 0] + rows[..., None] * matrix[:3, 1]
    start = (start @ index[:3, :3].T + index[:3, 3] - 0.5 * (SIDE - 1)) / half_axes
    along = -(index[:3, :3] @ matrix[:3, 2]) / half_axes
    b, a = start @ along, along @ along
    inside = b**2 - a * ((start**2).sum(axis=-1) - 1.0)
    met = start - ((b + np.sqrt(np.where(inside < 0.0, np.nan, inside))) / a)[..., None] * along
    normal = met / half_axes @ index[:3, :3]
    return normal / np.linalg.norm(normal, axis=-1, keepdims=True)


def lit_pixels(scene: Scene, normals: np.ndarray) -> np.ndarray:
    """(H, W) bool: the pixels of which the ripple is measured."""
    eye = scene.camera.matrix_world[:3, 2]
    towards = eye if scene.headlight else scene.lights[0].matrix_world[:3, 2]
    with np.errstate(invalid="ignore"):
        return (normals @ towards > 0.5) & (normals @ eye > 0.3)


def ripple(normals: np.ndarray, rgba: np.ndarray) -> float:
    """Percent, of (n, 3) normals and the (n, 4) colors there."""
    x, y, z = normals.T
    powers = [(i, j, k) for i in range(DEGREE + 1) for j in range(DEGREE + 1 - i) for k in range(DEGREE + 1 - i - j)]
    terms = np.stack([x**i * y**j * z**k for i, j, k in powers], axis=1)
    bright = rgba[:, 0] / rgba[:, 3]
    factors, *_ = np.linalg.lstsq(terms, bright, rcond=1e-10)
    return float(100.0 * np.diff(np.quantile(bright / (terms @ factors), (0.01, 0.99)))[0])


def main(arguments) -> int:
    qualities = {"choices": None, "default": ("draft", "standard", "fine", "strict")}
    parser = make_parser("dev.py bench ripple", __doc__, quality=qualities, probes=PROBES)
    parser.add_argument("--body", nargs="*", choices=list(BODIES), default=list(BODIES))
    parser.add_argument("--opacity", nargs="*", choices=list(OPACITIES), default=list(OPACITIES))
    parser.add_argument("--light", nargs="*", choices=list(LIGHTS), default=list(LIGHTS))
    parser.add_argument("--edge", type=float, default=4.0, help="voxels over which values fall")
    options = parser.parse_args(arguments)
    run, random = Run("ripple", arguments), np.random.default_rng(1)
    print(f"{'body':<12}{'opacity':<10}{'light':<18}{'reference':>10}" + "".join(f"{q:>10}" for q in options.quality))
    for name in options.body:
        volume = body(BODIES[name], options.edge)
        for opacity in options.opacity:
            for light in options.light:
                scene = lit_scene(volume, opacity, light)
                normals = normals_at(scene, BODIES[name])
                rows, columns = np.nonzero(lit_pixels(scene, normals))
                some = random.choice(len(rows), min(options.probes, len(rows)), replace=False)
                at = rows[some], columns[some]
                found = {"reference": ripple(normals[at], true_colors(scene, at[::-1]))}
                for quality in options.quality:
                    rgba = render(scene, Quality.preset(quality)).rgba
                    found[quality] = ripple(normals[rows, columns], rgba[rows, columns])
                run.rows.append({"body": name, "opacity": opacity, "light": light, **found})
                numbers = "".join(f"{one:10.2f}" for one in found.values())
                print(f"{name:<12}{opacity:<10}{light:<18}{numbers}", flush=True)
    run.keep()
    return 0
