"""The scenes on which the planner is calibrated, and those on which it is tested.

They have no volume, transfer function or view in common.  All calibration volumes are synthetic.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import zip_longest

import numpy as np

from devtools.phantom import SPACING_MM, head_phantom
from rle_splat.classify.presets import fit_preset, preset
from rle_splat.classify.transfer_function import Shade, TransferFunction
from rle_splat.read.formats import read_volume
from rle_splat.scene import Camera, Channel, Scene
from rle_splat.view.turntable import turntable
from rle_splat.volume.volume import Volume

from .phantoms import binary_shell, blobs, marschner_lobb, smooth_shell, thin_shell
from .scenes import DATA, shells, smoke

RAINBOW = ((0.0, 0.9, 0.3, 0.1), (0.2, 0.2, 0.8, 0.3), (0.5, 0.1, 0.3, 1.0), (1.0, 0.9, 0.9, 0.8))


@dataclass(frozen=True)
class View:
    """A turntable view of a square picture ``size`` pixels a side."""

    azimuth: float
    elevation: float
    size: int
    perspective: bool = False
    fit: float = 1.25
    fov: float = 40.0

    def of(self, volume: Volume, function: TransferFunction, shaded: bool) -> Scene:
        camera, matrix = turntable(volume, self.azimuth, self.elevation, self.fit, self.perspective, self.fov)
        return Scene(volume, function, camera, self.size, self.size, matrix, headlight=shaded)


def ramp(low: float, high: float, alpha: float, colors=RAINBOW, distance=1.0, shade=None) -> TransferFunction:
    """Opacity that rises from 0 at ``low`` to ``alpha`` at ``high``, with colors over [0, 2 high]."""
    color = tuple((2.0 * high * position, *rgb) for position, *rgb in colors)
    return TransferFunction("ramp", None, ((low, 0.0), (high, alpha)), color, distance, shade)


def bands(centers, half_width: float, alpha: float, distance=1.0, shade=None) -> TransferFunction:
    """Opacity tents around some values, which show iso-surfaces; narrow ones are harder to integrate."""
    opacity, color = [], []
    for number, center in enumerate(centers):
        opacity += [(center - half_width, 0.0), (center, alpha), (center + half_width, 0.0)]
        color.append((center, *RAINBOW[number % len(RAINBOW)][1:]))
    return TransferFunction("bands", None, tuple(opacity), tuple(color), distance, shade)


def _opacities(field) -> Volume:
    return Volume(np.asarray(field, np.float32), np.eye(4))


def _noise(size: int, seed: int, slope: float) -> np.ndarray:
    """A random field, uint8 from 0 to 255, with amplitudes proportional to frequency to the power of -``slope``."""
    random = np.random.default_rng(seed)
    waves = np.fft.rfftn(random.standard_normal((size,) * 3))
    k = np.sqrt(sum(f**2 for f in np.meshgrid(*(np.fft.fftfreq(size),) * 2, np.fft.rfftfreq(size), indexing="ij")))
    field = np.fft.irfftn(waves / np.maximum(k, 1.0 / size) ** slope, s=(size,) * 3, axes=(0, 1, 2))
    low, high = np.quantile(field, (0.001, 0.999))
    return np.clip(np.rint(255.0 * (field - low) / (high - low)), 0, 255).astype(np.uint8)


def _machine_part(size: int = 96) -> np.ndarray:
    """A block with holes, uint8 values 0, 120 and 230 with edges one voxel wide."""
    z, y, x = np.meshgrid(*(np.linspace(-1.0, 1.0, size),) * 3, indexing="ij")

    def soft(distance):
        return np.clip(0.5 + distance * size / 2.0, 0.0, 1.0)

    block = soft(np.minimum(np.minimum(0.8 - abs(x), 0.6 - abs(y)), 0.7 - abs(z + 0.1 * x)))
    bore = soft(0.25 - np.hypot(x - 0.3, y + 0.1))
    cross = soft(0.15 - np.hypot(y - 0.2, z))
    core = soft(0.2 - np.sqrt((x + 0.4) ** 2 + y**2 + (z - 0.2) ** 2))
    solid = block * (1.0 - bore) * (1.0 - cross)
    return np.rint(120.0 * solid * (1.0 - core) + 230.0 * core * block).astype(np.uint8)


def _signal(size: int = 56) -> Volume:
    axis = np.linspace(-1.0, 1.0, size)
    z, y, x = np.meshgrid(axis, axis, axis, indexing="ij")
    field = marschner_lobb(np.stack((x, y, z), axis=-1))
    return Volume(field.astype(np.float32), np.eye(4))


OPACITY_IS_VALUE = TransferFunction("opacity is the value", None, ((0.0, 0.0), (1.0, 1.0)), RAINBOW, 1.0, None)


def calibration_volumes() -> Iterator[tuple[str, Volume, TransferFunction, bool]]:
    """Yield name, volume, transfer function, and whether it is shaded."""
    yield "smooth", _opacities(smooth_shell(80)), OPACITY_IS_VALUE, False
    yield "thin", _opacities(thin_shell(72)), OPACITY_IS_VALUE, False
    yield "binary", _opacities(binary_shell(64)), OPACITY_IS_VALUE, False
    yield "blobs", _opacities(blobs((80, 72, 64), 3)), OPACITY_IS_VALUE, False
    grainy = Volume(_noise(72, 1, 2.2), np.diag((1.0, 1.0, 1.4, 1.0)))
    yield "noise, bands", grainy, bands((150.0, 200.0), 8.0, 0.7), False
    cloud = Volume(_noise(96, 2, 2.8), np.eye(4))
    yield "cloud", cloud, ramp(110.0, 250.0, 0.08), False
    yield "cloud, lit", cloud, ramp(150.0, 190.0, 0.6, shade=Shade()), True
    part = Volume(_machine_part(), np.eye(4))
    yield "part", part, ramp(60.0, 110.0, 0.9, shade=Shade()), True
    yield "part, core", part, bands((120.0, 230.0), 40.0, 0.5), False
    signal = _signal()
    yield "signal", signal, bands((0.5,), 0.06, 0.9, shade=Shade()), True
    head = Volume(head_phantom(2.0 * SPACING_MM), np.diag((*(2.0 * SPACING_MM,) * 3, 1.0)), unit="mm", value_unit="HU")
    yield "head", head, preset("ct-bone"), True
    yield "head, skin", head, preset("ct-soft-tissue"), False


CALIBRATION_VIEWS = (
    View(35.0, 25.0, 112),
    View(35.0, 25.0, 112, True),
    View(10.0, 5.0, 192),
    View(-60.0, 75.0, 144, True, fit=1.0, fov=60.0),
)


def calibration_scenes() -> Iterator[tuple[str, Scene]]:
    """Yield name and scene for every calibration volume and view."""
    for name, volume, function, shaded in calibration_volumes():
        for number, view in enumerate(CALIBRATION_VIEWS):
            yield f"{name}, view {number}", view.of(volume, function, shaded)


# --- test scenes ----------------------------------------------------------------------------------------------


def _lemon(size: int = 88) -> Volume:
    """A layered ellipsoid, off center and oblique, int16 values like HU, spacing 1, 1, 1.5."""
    z, y, x = np.meshgrid(*(np.linspace(-1.0, 1.0, size),) * 3, indexing="ij")
    radius = np.sqrt((x + 0.1) ** 2 / 0.7 + (y - 0.2 * z) ** 2 / 0.45 + (z + 0.05) ** 2 / 0.6)
    ripple = 0.06 * np.sin(9.0 * x + 2.0) * np.sin(8.0 * y) * np.sin(7.0 * z + 1.0)
    return Volume(np.rint(1400.0 * (0.95 - radius + ripple)).astype(np.int16), np.diag((1.0, 1.0, 1.5, 1.0)))


def _tubes(size: int = 96) -> Volume:
    """Winding tubes two to four voxels wide in fog, float32."""
    z, y, x = np.meshgrid(*(np.arange(size, dtype=np.float64),) * 3, indexing="ij")
    field = 0.15 * np.exp(-((x - 48.0) ** 2 + (y - 40.0) ** 2 + (z - 52.0) ** 2) / 1800.0)
    for number in range(5):
        phase, center = 1.3 * number, 20.0 + 14.0 * number
        across = (y - center - 9.0 * np.sin(0.09 * x + phase)) ** 2 + (z - 48.0 - 20.0 * np.cos(0.07 * x + phase)) ** 2
        field += np.exp(-0.5 * across / (1.0 + 0.35 * number) ** 2)
    return Volume(field.astype(np.float32), np.eye(4))


def _inside(volume: Volume, function: TransferFunction, size: int, share, towards, shaded: bool) -> Scene:
    """A view from a point inside the volume's box to another one (both as fractions of its sides), lens 24 mm."""
    corner = (np.array(volume.shape_xyz) - 1.0) * volume.spacing
    eye, aim = corner * share, corner * towards
    ahead = (aim - eye) / np.linalg.norm(aim - eye)
    right = np.cross(ahead, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack((right, np.cross(right, ahead), -ahead), axis=1)
    matrix[:3, 3] = eye
    camera = Camera(matrix, lens=24.0, clip_start=1e-3, clip_end=1e4)
    straight = replace(volume, affine=np.diag((*volume.spacing, 1.0)))
    return Scene(straight, function, camera, size, size, headlight=shaded)


# File, how to read it, preset, shaded, view.
MEASURED_SCANS = {
    "engine, outside": ("engine_256x256x110_uint8.raw.gz", {}, "ct-industrial", True, View(-30.0, 20.0, 320)),
    "bonsai, perspective": (
        "bonsai_256x256x256_uint8.raw.gz", {}, "ct-botanical", False, View(70.0, 15.0, 320, True, 1.1),
    ),
    "MR head": (
        "mrbrain_256x256x99_uint8.raw.gz", dict(spacing=(1.0, 1.0, 2.0)), "mr-head", True, View(150.0, 10.0, 256),
    ),
    "lobster, perspective": (
        "lobster_301x324x56_uint8.raw.gz", dict(spacing=(1.0, 1.0, 1.4)), "ct-specimen", True,
        View(25.0, 55.0, 288, True),
    ),
    "CT head, perspective": (
        "cthead_256x256x113_uint16be.raw.gz", dict(spacing=(1.0, 1.0, 2.0)), "ct-bone", True,
        View(-110.0, 40.0, 256, True, 1.3),
    ),
    "foot": ("foot_256x256x256_uint8_fromjpeg.raw.gz", {}, "xa-limb", False, View(20.0, 5.0, 256)),
}  # fmt: skip


def measured_scenes(names=None) -> Iterator[tuple[str, Scene]]:
    """Yield the name and scene of each test scene, or of those in ``names``: synthetic ones, and the scans present."""
    lemon, tubes = _lemon(), _tubes()
    volume, function = shells(128)
    narrow = bands((350.0, 700.0), 60.0, 0.8)
    wide = ramp(100.0, 1200.0, 0.15, shade=Shade())
    thin = bands((0.5,), 0.12, 0.9, shade=Shade())
    soft = ramp(0.05, 1.2, 0.3)
    made = {
        "shells": lambda: View(-20.0, 35.0, 256).of(volume, function, True),
        "lemon, narrow": lambda: View(55.0, -20.0, 224).of(lemon, narrow, False),
        "lemon, wide, perspective": lambda: View(100.0, 30.0, 224, True, 1.1, 50.0).of(lemon, wide, True),
        "tubes, thin": lambda: View(75.0, 12.0, 256, True).of(tubes, thin, True),
        "tubes, soft": lambda: View(5.0, 62.0, 320).of(tubes, soft, False),
        "inside the lemon": lambda: _inside(lemon, wide, 160, (0.5, 0.12, 0.5), (0.45, 0.9, 0.4), True),
        "inside the tubes": lambda: _inside(tubes, soft, 160, (0.15, 0.55, 0.5), (0.9, 0.4, 0.45), False),
    }
    scans = {
        name: partial(_scan, *scan) for name, scan in MEASURED_SCANS.items() if (DATA / scan[0]).exists()
    }  # fmt: skip
    # Alternate both kinds, so that a shortened run has both.
    for pair in zip_longest(made.items(), scans.items()):
        for name, make in filter(None, pair):
            if not names or name in names:
                yield name, make()


def _lit_smoke() -> Scene:
    """A plume of haze without surfaces."""
    haze = ramp(0.02, 1.0, 0.12, shade=Shade())
    return View(40.0, 10.0, 224, True, 1.1).of(smoke((72, 72, 112)), haze, True)


def _two_channels() -> Scene:
    """Two channels whose blobs overlap."""
    volumes = [
        Volume(np.rint(255.0 * field / field.max()).astype(np.uint8), np.eye(4))
        for field in (blobs((80, 80, 80), seed, 12, (4.0, 8.0)) for seed in (5, 6))
    ]
    soft, hard = (ramp(*values, shade=Shade()) for values in ((20.0, 200.0, 0.2), (60.0, 120.0, 0.8)))
    first = View(-50.0, 30.0, 224).of(volumes[0], soft, True)
    return replace(first, channels=(Channel(volumes[1], hard),))


def further_lit_scenes(names=None) -> Iterator[tuple[str, Scene]]:
    """Yield the name and scene of those that tolerances are tested on under lamps alone, as ``measured_scenes``."""
    head = DATA / MEASURED_SCANS["CT head, perspective"][0]
    skin = partial(_scan, head.name, dict(spacing=(1.0, 1.0, 2.0)), "ct-skin", True, View(-60.0, 10.0, 256))
    made = {"smoke": _lit_smoke, "two channels": _two_channels, **({"CT head, skin": skin} if head.exists() else {})}
    for name, make in made.items():
        if not names or name in names:
            yield name, make()


def _scan(file: str, options: dict, preset: str, shaded: bool, view: View) -> Scene:
    scan = read_volume(DATA / file, **options)
    return view.of(scan, fit_preset(preset, scan)[0], shaded)
