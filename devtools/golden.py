"""Golden pictures, as a person has approved them: each preset on the computed head, and a photograph of each window.

    python3 dev.py golden             lists what has changed; sheets of before, now and the difference
    python3 dev.py golden --approve   puts today's pictures in the place of those that have changed

tests/unit/test_golden.py compares today's pictures of presets.  Photographs are those that the last run of windows has
left in build/window-shots; the whole test run compares them after its windows.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from rle_splat.classify.presets import PRESETS, fit_preset
from rle_splat.pipeline.stage_cache import StageCache
from rle_splat.pipeline.thumbnail import thumbnail_steps
from rle_splat.runtime.steps import drain
from rle_splat.volume.volume import Volume

from .phantom import EXTENT_MM, head_phantom
from .places import BUILD, ROOT
from .real_blender_tests import PHOTOGRAPHS, SHOTS

FOLDER = ROOT / "tests" / "unit" / "golden"
SHEET = BUILD / "golden.png"
WINDOWS, WINDOWS_SHEET = ROOT / "tests" / "blender" / "golden", BUILD / "golden-windows.png"
SPACING = 5.0  # millimeters of the head's voxels
POOLED = 2  # pixels of a thumbnail a side that one of a golden picture stands for: files of at most 8 KB

SHRUNK = 8  # pixels of a screen a side that one of a thumbnail stands for
STATUS = 32  # pixels at the bottom, where Blender shows messages for some seconds

# Shown at a distance at which a pixel is 1/67 of a degree, as FLIP has it, the eye blurs by about a pixel.
BLUR = 1.0  # standard deviation, pixels
# Linear sRGB to XYZ (IEC 61966-2-1), divided by the white of D65, as CIELAB takes it.
XYZ = np.array(((0.4124, 0.3576, 0.1805), (0.2126, 0.7152, 0.0722), (0.0193, 0.1192, 0.9505)))
XYZ /= XYZ.sum(axis=1, keepdims=True)
# A picture has changed where the mean of its differences, or the largest, is above these.  A person who compares two
# patches sees a difference of about 1.  Kernels and the reference implementation differ by 0.08 and 1.04.
MEAN, LARGEST = 0.4, 3.0
# The largest of a photograph of a window, where another word in a panel is no change (up to 8.5).
LARGEST_OF_WINDOW = 12.0


def _pooled(picture: np.ndarray, side: int) -> np.ndarray:
    """A picture (H, W, 3) with one pixel for each square of ``side`` pixels; a rest at the right and the bottom is cut
    off."""
    height, width = (length // side for length in picture.shape[:2])
    blocks = picture[: height * side, : width * side].reshape(height, side, width, side, 3)
    return np.rint(blocks.mean(axis=(1, 3), dtype=np.float64)).astype(np.uint8)


def photographs() -> dict[str, np.ndarray]:
    """The thumbnail of today's photograph for each of PHOTOGRAPHS that there is, by the script's name, uint8, sRGB."""
    from PIL import Image

    files = [
        (script, path) for script, name in PHOTOGRAPHS.items() for path in SHOTS.glob(f"{script}/{name}.[pj][np]g")
    ]
    return {script: _pooled(np.asarray(Image.open(path).convert("RGB"))[:-STATUS], SHRUNK) for script, path in files}


def pictures() -> dict[str, np.ndarray]:
    """The thumbnail of each preset by name, (SIDE / POOLED, SIDE / POOLED, 3) uint8, sRGB."""
    corner = np.diag((-SPACING, -SPACING, SPACING, 1.0))  # the phantom's axes are right, front and head
    corner[:3, 3] = np.array((-1.0, -1.0, 1.0)) * [low for low, _ in EXTENT_MM]
    head = Volume(head_phantom(SPACING), corner, space="patient", value_unit="HU")
    cache, made = StageCache(), {}
    for name in PRESETS:
        function, _ = fit_preset(name, head)
        made[name] = _pooled(drain(thumbnail_steps(head, function, SPACING, cache)), POOLED)
    return made


def _lab(picture: np.ndarray) -> np.ndarray:
    """CIELAB of an sRGB picture (H, W, 3) uint8, blurred in linear light as the eye does."""
    encoded = picture / 255.0
    linear = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    reach = int(np.ceil(3.0 * BLUR))
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / BLUR) ** 2)
    weights /= weights.sum()
    for axis in (0, 1):
        padded = np.pad(linear, [(reach, reach) if one == axis else (0, 0) for one in range(3)], mode="edge")
        linear = np.apply_along_axis(np.convolve, axis, padded, weights, mode="valid")
    xyz = linear @ XYZ.T
    root = np.where(xyz > (6 / 29) ** 3, np.cbrt(xyz), xyz / (3 * (6 / 29) ** 2) + 4 / 29)
    x, y, z = np.moveaxis(root, -1, 0)
    return np.stack((116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)), axis=-1)


def difference(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """(H, W) float64: how different two pictures (H, W, 3) of sRGB, uint8, look.

    Distances of blurred colors in CIELAB, of lightness and hue apart and added up: FLIP's path for colors (Andersson et
    al. 2020, section 4.1), with one Gaussian for its three filters of contrast sensitivity and without its exponent:
    HyAB keeps large differences in proportion (Abasi et al. 2020).
    """
    apart = _lab(one) - _lab(other)
    return np.abs(apart[..., 0]) + np.hypot(apart[..., 1], apart[..., 2])


def is_same(apart: np.ndarray, largest: float = LARGEST) -> bool:
    """Whether differences (H, W) are those of roundings; ``largest``: of one pixel."""
    return bool(apart.mean() <= MEAN and apart.max() <= largest)


def load(name: str, folder: Path = FOLDER) -> np.ndarray | None:
    """The approved picture of a preset, or of a script in another ``folder``, or None."""
    from PIL import Image

    path = folder / f"{name}.png"
    return np.asarray(Image.open(path).convert("RGB")) if path.is_file() else None


def _row(before: np.ndarray, now: np.ndarray, apart: np.ndarray) -> np.ndarray:
    """Before, now and the difference (white: LARGEST) side by side, twice as large."""
    gray = np.clip(255.0 * apart / LARGEST, 0.0, 255.0).astype(np.uint8)
    row = np.concatenate((before, now, np.repeat(gray[..., None], 3, axis=2)), axis=1)
    return row.repeat(2, axis=0).repeat(2, axis=1)


def compare(
    today: dict[str, np.ndarray], names, approve: bool, folder: Path, sheet: Path, largest: float = LARGEST
) -> list[str]:
    """Print what differs from the pictures in ``folder``, and write the sheet; the names of those that have changed.

    ``names``: of all that there should be.  ``approve``: put today's pictures in their place, and remove others.
    """
    from PIL import Image

    rows, changed = [], []
    for name, now in today.items():
        before = load(name, folder)
        if before is None or before.shape != now.shape:
            before = np.zeros_like(now)
        apart = difference(before, now)
        print(f"{name:<20} mean {apart.mean():6.3f}, largest {apart.max():7.3f}")
        if not is_same(apart, largest):
            changed.append(name)
            rows.append(_row(before, now, apart))
            if approve:
                folder.mkdir(exist_ok=True)
                Image.fromarray(now).save(folder / f"{name}.png", optimize=True)
    gone = sorted(path.stem for path in folder.glob("*.png") if path.stem not in names)
    for name in gone if approve else ():
        (folder / f"{name}.png").unlink()
    if rows:
        sheet.parent.mkdir(exist_ok=True)
        width = max(row.shape[1] for row in rows)
        rows = [np.pad(row, ((0, 0), (0, width - row.shape[1]), (0, 0))) for row in rows]
        Image.fromarray(np.concatenate(rows)).save(sheet)
        print(f"before, now and the difference are in {sheet}")
    return changed + gone


def main(words=None) -> int:
    """Returns 1 where pictures have changed and are not approved."""
    parser = argparse.ArgumentParser(prog="dev.py golden", description=__doc__.partition("\n")[0])
    parser.add_argument("--approve", action="store_true", help="put today's pictures in the place of the changed ones")
    parser.add_argument("--windows", action="store_true", help="photographs alone, of which none may be missing")
    args = parser.parse_args(words)
    shown = photographs()
    changed = compare(shown, PHOTOGRAPHS, args.approve, WINDOWS, WINDOWS_SHEET, LARGEST_OF_WINDOW)
    if args.windows:
        missing = [name for name in PHOTOGRAPHS if name not in shown]
        for name in missing:
            print(f"there is no photograph {PHOTOGRAPHS[name]!r} of {name}")
        changed += missing
        print(f"{len(PHOTOGRAPHS) - len(changed)} passed, {len(changed)} failed, 0 skipped")
    else:
        changed += compare(pictures(), PRESETS, args.approve, FOLDER, SHEET)
    if changed:
        print(f"{'approved' if args.approve else 'changed'}: {', '.join(changed)}")
    return int(bool(changed) and not args.approve)


if __name__ == "__main__":
    raise SystemExit(main())
