"""Golden pictures: a thumbnail of each preset on the computed head, as a person has approved it.

    python3 dev.py golden             lists what has changed; a sheet of before, now and the difference
    python3 dev.py golden --approve   puts today's pictures in the place of those that have changed

tests/unit/test_golden.py compares today's pictures with the approved ones.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from rle_splat.classify.presets import PRESETS, fit_preset
from rle_splat.pipeline.stage_cache import StageCache
from rle_splat.pipeline.thumbnail import SIDE, thumbnail_steps
from rle_splat.runtime.steps import drain
from rle_splat.volume.volume import Volume

from .phantom import EXTENT_MM, head_phantom
from .places import BUILD, ROOT

FOLDER = ROOT / "tests" / "unit" / "golden"
SHEET = BUILD / "golden.png"
SPACING = 5.0  # millimeters of the head's voxels
POOLED = 2  # pixels of a thumbnail a side that one of a golden picture stands for: files of at most 8 KB

# Shown at a distance at which a pixel is 1/67 of a degree, as FLIP has it, the eye blurs by about a pixel.
BLUR = 1.0  # standard deviation, pixels
# Linear sRGB to XYZ (IEC 61966-2-1), divided by the white of D65, as CIELAB takes it.
XYZ = np.array(((0.4124, 0.3576, 0.1805), (0.2126, 0.7152, 0.0722), (0.0193, 0.1192, 0.9505)))
XYZ /= XYZ.sum(axis=1, keepdims=True)
# A picture has changed where the mean of its differences, or the largest, is above these.  A person who compares two
# patches sees a difference of about 1.  Kernels and the reference implementation differ by 0.08 and 1.04.
MEAN, LARGEST = 0.4, 3.0


def pictures() -> dict[str, np.ndarray]:
    """The thumbnail of each preset by name, (SIDE / POOLED, SIDE / POOLED, 3) uint8, sRGB."""
    corner = np.diag((-SPACING, -SPACING, SPACING, 1.0))  # the phantom's axes are right, front and head
    corner[:3, 3] = np.array((-1.0, -1.0, 1.0)) * [low for low, _ in EXTENT_MM]
    head = Volume(head_phantom(SPACING), corner, space="patient", value_unit="HU")
    cache, made = StageCache(), {}
    for name in PRESETS:
        function, _ = fit_preset(name, head)
        whole = drain(thumbnail_steps(head, function, SPACING, cache)).astype(np.float64)
        blocks = whole.reshape(SIDE // POOLED, POOLED, SIDE // POOLED, POOLED, 3)
        made[name] = np.rint(blocks.mean(axis=(1, 3))).astype(np.uint8)
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
    """How different two pictures look, pixel by pixel.

    Parameters
    ----------
    one, other : (H, W, 3) ndarray of uint8
        sRGB.

    Returns
    -------
    (H, W) ndarray of float64
        Distances of blurred colors in CIELAB, of lightness and hue apart and added up.

    Notes
    -----
    FLIP's path for colors (Andersson et al. 2020, section 4.1), with one Gaussian for its three filters of contrast
    sensitivity and without its exponent: HyAB keeps large differences in proportion (Abasi et al. 2020).
    """
    apart = _lab(one) - _lab(other)
    return np.abs(apart[..., 0]) + np.hypot(apart[..., 1], apart[..., 2])


def is_same(apart: np.ndarray) -> bool:
    """Whether differences (H, W) are those of roundings."""
    return bool(apart.mean() <= MEAN and apart.max() <= LARGEST)


def load(name: str) -> np.ndarray | None:
    """The approved picture of a preset, or None."""
    from PIL import Image

    path = FOLDER / f"{name}.png"
    return np.asarray(Image.open(path).convert("RGB")) if path.is_file() else None


def _row(before: np.ndarray, now: np.ndarray, apart: np.ndarray) -> np.ndarray:
    """Before, now and the difference (white: LARGEST) side by side, twice as large."""
    gray = np.clip(255.0 * apart / LARGEST, 0.0, 255.0).astype(np.uint8)
    row = np.concatenate((before, now, np.repeat(gray[..., None], 3, axis=2)), axis=1)
    return row.repeat(2, axis=0).repeat(2, axis=1)


def compare(approve: bool, folder: Path, sheet: Path) -> list[str]:
    """Print what differs from the pictures in ``folder``, and write the sheet; the names of those that have changed.

    ``approve``: put today's pictures in their place, and remove those of presets that are gone.
    """
    from PIL import Image

    today, rows, changed = pictures(), [], []
    for name, now in today.items():
        path = folder / f"{name}.png"
        before = np.asarray(Image.open(path).convert("RGB")) if path.is_file() else np.zeros_like(now)
        apart = difference(before, now)
        print(f"{name:<20} mean {apart.mean():6.3f}, largest {apart.max():7.3f}")
        if not is_same(apart):
            changed.append(name)
            rows.append(_row(before, now, apart))
            if approve:
                folder.mkdir(exist_ok=True)
                Image.fromarray(now).save(path, optimize=True)
    gone = sorted(path.stem for path in folder.glob("*.png") if path.stem not in today)
    for name in gone if approve else ():
        (folder / f"{name}.png").unlink()
    if rows:
        sheet.parent.mkdir(exist_ok=True)
        Image.fromarray(np.concatenate(rows)).save(sheet)
    return changed + gone


def main(words=None) -> int:
    """Returns 1 where pictures have changed and are not approved."""
    parser = argparse.ArgumentParser(prog="dev.py golden", description=__doc__.partition("\n")[0])
    parser.add_argument("--approve", action="store_true", help="put today's pictures in the place of the changed ones")
    approve = parser.parse_args(words).approve
    changed = compare(approve, FOLDER, SHEET)
    if changed:
        done = "approved" if approve else "changed"
        print(f"{', '.join(changed)}: {done}; before, now and the difference are in {SHEET.relative_to(ROOT)}")
    return int(bool(changed) and not approve)


if __name__ == "__main__":
    raise SystemExit(main())
