"""dev.py figures: figures of the documentation, made by the command line with options of users.

Runs in an environment with numpy, pydicom and Pillow: ``python -m devtools.example_figures``.  The scan is the skull of
the data folder (``RLE_SPLAT_DATA``); without it, the practice scan.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import shutil
import subprocess
import sys
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

import rle_splat as rs
from rle_splat.classify.presets import PRESETS
from rle_splat.scene.display import to_bytes

from .docs import python_of
from .gallery_pictures import save_jpeg
from .places import OUT, ROOT
from .sheets import sheet

FOLDER = OUT / "figures"
PYTHON_PAGE = ROOT / "docs" / "how-to" / "use-from-python.md"
OTHERS = ROOT / "docs" / "how-to" / "python-with-other-libraries.md"
PYTHON_TUTORIAL = ROOT / "docs" / "tutorial" / "first-figure-from-python.md"
MANY = ROOT / "docs" / "how-to" / "picture-many-scans.md"
SKULL = "dicom_ct_skull_phantom_512x512x140"
BRAIN = "flair_brain_124x160x140_uint8.nrrd"
CHEST = "cta_aorta_labels/cta_heart_aorta_120x126x164_int16.nii.gz"
HEAD = "cthead_256x256x113_uint16be.raw.gz"  # its spacing is known as 1 : 1 : 2
OF_HEAD = {
    "shape": (256, 256, 113), "dtype": "uint16", "byte_order": "big", "spacing": (0.9, 0.9, 1.8), "orientation": "LPI",
    "intercept": -1024.0, "value_unit": "HU", "modality": "CT",
}  # fmt: skip
ROWS = 236  # of it; behind them is the head's holder
MORE_SCANS = (  # of the page on many scans
    ("2 Chest.nii.gz", CHEST), ("3 Plastic skull", SKULL), ("4 Chest, 46 mm", "dicom_ct_chest_512x512x46"),
    ("5 Chest, 76 mm", "dicom_ct_chest_cta_512x512x95"), ("6 Brain.nrrd", BRAIN),
)  # fmt: skip
VIEWS = ((0, 0), (90, 0), (180, 0))  # azimuth and elevation
OBLIQUE = ("--azimuth", "30", "--elevation", "15", "--fit", "0.95")
SMALL, POSTER, EYE = 360, 3600, (735, 2470)  # pixels: a picture's side, a poster's, and where a part of it begins
PYTHON = 480  # pixels: a side of the pictures of the page on Python
LARGEST = 900, 1400  # pixels: width and height of a figure
TILE, WORKERS = 90, ("#4477aa", "#ee6677", "#228833", "#ccbb44")  # pixels; a color for each
MOST_BYTES, GRAY = 80_000, "#303030"
ABOVE_LEFT = (-0.7, 0.8, 0.8)  # of a camera: the sun of the turntable
TURN, MILLISECONDS = 60, 66  # frames of the turntable, and how long each is shown
FIRST = "--fit", "0.9", "--quality", "fine"
TURNED = "--azimuth", "35", "--elevation", "20"
LIT = "--antialias", "--light-recipe", "soft"
CLOSE = ("--azimuth", "30", "--elevation", "20", "--fit", "0.42", "--size", "400")
CROPS = {  # of the README: photographs of windows, and the part of each
    "readme-live": ("how-to-live", (240, 85, 900, 580)),
    "readme-slice": ("how-to-window", (0, 515, 800, 932)),
}
STEPS = (  # of the strip, after the slices: captions, pictures of the documentation, and the part of each
    ("Bone", "tutorial-3-preset", (230, 304, 790, 724)),
    ("Cut open", "tutorial-7-rendered", (240, 167, 1036, 764)),
    ("The finished scene", "gallery-skull", (0, 0, 1600, 1200)),
)
FILM, FILM_SIZE = ROOT / "build" / "window-shots" / "record_film", (640, 480)
STEP = 560, 420  # pixels of a picture of the strip


def data_folder() -> Path:
    return Path(os.environ.get("RLE_SPLAT_DATA") or ROOT.parent / "shared" / "data")


def opaque_bone(folder: Path) -> list[str]:
    """The preset CT Bone with thin walls that are whole and opaque: lower by 100 HU, and for a thickness of 0.05 mm."""
    bone = json.loads(PRESETS["ct-bone"].path.read_text(encoding="utf-8"))
    air, *others = bone["opacity"]
    bone.update(opacity=[air, *((value - 100.0, alpha) for value, alpha in others)], opacity_unit_distance=0.05)
    path = folder / "bone.json"
    path.write_text(json.dumps(bone), encoding="utf-8")
    return ["--transfer-function", str(path), "--smoothness", "1"]


def skull_words(folder: Path) -> list[str]:
    """What each command line takes of the scan."""
    series = data_folder() / SKULL
    if not series.is_dir():
        from .practice_ct import write_series

        series = folder / "practice-ct"
        write_series(series)
    return [str(series), *opaque_bone(folder)]


def command_lines(folder: Path) -> list[list[str]]:
    """The figures, a brain, and a part of the skull in two qualities."""
    skull, views = skull_words(folder), [word for view in VIEWS for word in ("--view", *map(str, view))]
    brain = data_folder() / BRAIN
    turned = brain if brain.is_file() else skull[0]
    page = ["figure", *skull, "--columns", "3", "--quality", "fine"]
    return [
        [*page, *views, "-o", str(folder / "figure-skull.svg"), "-o", str(folder / "figure-skull.png")],
        *(["render", *skull, *CLOSE, "--quality", quality, "-o", str(folder / f"how-to-{quality}.png")]
          for quality in ("draft", "fine")),
        *(["render", str(turned), *FIRST, *more, "--size", "512", "-o", str(folder / f"{name}.png")]
          for name, more in (("out", ()), ("side", (*TURNED, *LIT)))),
        ["render", str(turned), "--frames", "1", "4", "--turn", "30", "--fit", "1.1", "--quality", "fine",
         "--size", str(SMALL), "-o", str(folder / "turn.png")],
        ["figure", str(turned), *TURNED, "--quality", "fine", "-o", str(folder / "first-figure.png")],
        ["render", *skull, *OBLIQUE, "--size", str(SMALL), "-o", str(folder / "whole.png")],
        ["render", *skull, *OBLIQUE, "--size", str(SMALL), "--level", "2", "-o", str(folder / "coarse.png")],
        ["render", *skull, *OBLIQUE, "--size", str(POSTER), "--crop", *map(str, EYE), *(str(at + SMALL) for at in EYE),
         "-o", str(folder / "part.png")],
    ]  # fmt: skip


def on_gray(picture: Image.Image) -> Image.Image:
    """A picture before dark gray."""
    return Image.alpha_composite(Image.new("RGBA", picture.size, GRAY), picture.convert("RGBA")).convert("RGB")


def beside(folder: Path, name: str, pictures: dict[str, Image.Image], most: int = MOST_BYTES, **more) -> None:
    """A sheet of pictures by their captions, on dark gray, as JPEG."""
    parts = [(caption, np.asarray(on_gray(one))) for caption, one in pictures.items()]
    save_jpeg(Image.fromarray(sheet(parts, **more)), folder / f"{name}.jpg", most)


def picture_and_depth(folder: Path) -> None:
    """how-to-python.jpg: a picture, its depth, and one that is lit and cut, by the code of the page on Python."""
    code = python_of(PYTHON_PAGE).partition("import numpy")[0]
    for old, new in (("scan.nii.gz", skull_words(folder)[0]), ("800", f"{PYTHON}"), ("600", f"{PYTHON}")):
        code = code.replace(old, new)
    names = {}
    with contextlib.chdir(folder):
        exec(code, names)
    made, opened = names["rendering"], names["opened"]
    seen = made.rgba[..., 3] > 0.5
    near, far = np.quantile(made.depth[seen], (0.01, 0.99))
    gray = np.where(seen, np.clip(1.0 - 0.85 * (made.depth - near) / (far - near), 0.0, 1.0), 0.0)

    def picture(rendering):
        return Image.fromarray(rendering.to_srgb("black"))

    depth = Image.fromarray(np.uint8(np.rint(255.0 * gray)), "L")
    parts = {"rendering.rgba": picture(made), "rendering.depth": depth, "opened": picture(opened)}
    beside(folder, "how-to-python", parts)


def opening(folder: Path) -> None:
    """how-to-opening.webp: the frames of tests/blender/record_film.py, there and back with a rest at both ends."""
    frames = [Image.open(path).convert("RGB") for path in sorted(FILM.glob("frame-*.png"))]
    if not frames:
        return
    frames = [one.resize(FILM_SIZE, Image.Resampling.LANCZOS) for one in frames]
    frames += frames[-1:] * 8 + frames[::-1] + frames[:1] * 4
    # Every frame is a key frame: differences of frames leave blocks on smooth surfaces.
    frames[0].save(folder / "how-to-opening.webp", save_all=True, append_images=frames[1:], duration=MILLISECONDS,
                   loop=0, quality=60, method=6, kmin=0, kmax=1)  # fmt: skip


def run(code: str, own: Path) -> dict:
    """Run Python code on a brain, in a folder of its own; return the names that it makes."""
    shutil.rmtree(own, ignore_errors=True)
    own.mkdir()
    shutil.copyfile(data_folder() / BRAIN, own / "FLAIR.nrrd")
    names = {}
    with contextlib.chdir(own):
        exec(code, names)
    return names


def run_page(page: Path, own: Path, name: str) -> None:
    """Run the Python code of a page in the folder ``own``; ``name``.jpg beside it is the page's figure."""
    names = run(python_of(page), own)
    figure = Image.open(io.BytesIO(names["figure"]._repr_png_())).convert("RGB")
    figure.thumbnail(LARGEST, Image.Resampling.LANCZOS)
    save_jpeg(figure, own.parent / f"{name}.jpg", MOST_BYTES)


def many(folder: Path) -> None:
    """how-to-many.jpg: the contact sheet of the page on many scans; with the data folder alone."""
    if not (data_folder() / HEAD).is_file():
        return
    own = folder / "many"
    shutil.rmtree(own, ignore_errors=True)
    (own / "scans").mkdir(parents=True)
    head = rs.read_volume(data_folder() / HEAD, **OF_HEAD)
    rs.write_volume(replace(head, voxels=head.voxels[:, :ROWS]), own / "scans" / "1 Head.nrrd")
    for name, scan in MORE_SCANS:
        (own / "scans" / name).symlink_to(data_folder() / scan)
    (own / "many.py").write_text(python_of(MANY), encoding="utf-8")
    subprocess.run([sys.executable, "many.py"], cwd=own, env={**os.environ, "PYTHONPATH": str(ROOT)}, check=True)
    save_jpeg(Image.open(own / "sheet.png"), folder / "how-to-many.jpg", 2 * MOST_BYTES)


def python_examples(folder: Path) -> None:
    """What the Python code of the README, of the tutorial and, with PyVista, of the page on other libraries make.

    With the data folder alone.
    """
    if not (data_folder() / BRAIN).is_file():
        return
    run_page(ROOT / "README.md", folder / "readme", "readme-python")
    run_page(PYTHON_TUTORIAL, folder / "tutorial", "first-python-figure")
    steps = {name: Image.open(folder / "tutorial" / name).reduce(2) for name in ("first.png", "lit.png", "cut.png")}
    beside(folder, "first-python", steps)
    if find_spec("pyvista"):
        begin, code = python_of(OTHERS).partition("from dataclasses")[1:]
        run(begin + code.partition("def volume_of")[0], folder / "pyvista")
        save_jpeg(
            Image.open(folder / "pyvista" / "electrode.png").convert("RGB"), folder / "how-to-pyvista.jpg", MOST_BYTES
        )


def from_parts(folder: Path) -> None:
    """The pictures that are put together from others."""
    whole, coarse, part = (Image.open(folder / f"{name}.png").convert("RGBA") for name in ("whole", "coarse", "part"))
    beside(folder, "how-to-coarse", {"--level 2": coarse, "All voxels": whole})
    turned = [f"turn_{number:04}.png" for number in range(1, 5)]
    beside(folder, "how-to-frames", {name: Image.open(folder / name) for name in turned}, across=4)
    figure = Image.open(folder / "first-figure.png").convert("RGB")
    figure.thumbnail((800, 1200), Image.Resampling.LANCZOS)
    save_jpeg(figure, folder / "first-figure.jpg", MOST_BYTES)
    beside(folder, "first-picture", {f"{name}.png": Image.open(folder / f"{name}.png") for name in ("out", "side")})
    framed, scale = whole.copy(), SMALL / POSTER
    corners = [scale * at for at in (*EYE, EYE[0] + SMALL, EYE[1] + SMALL)]
    ImageDraw.Draw(framed).rectangle(corners, outline="#ffb000", width=2)
    beside(folder, "how-to-poster", {"The whole picture": framed, "The framed part": part})
    tiled = whole.copy()
    draw = ImageDraw.Draw(tiled)
    places = [(x, y) for y in range(0, SMALL, TILE) for x in range(0, SMALL, TILE)]
    for number, (x, y) in enumerate(places):
        color = WORKERS[(number + y // TILE) % len(WORKERS)]
        draw.rectangle((x + 1, y + 1, x + TILE - 2, y + TILE - 2), outline=color, width=3)
    beside(folder, "how-to-tiles", {"Tiles of four workers": tiled, "The picture": whole})
    picture_and_depth(folder)
    python_examples(folder)
    many(folder)
    turn(folder)
    effects(folder)
    strip(folder)
    crops()
    opening(folder)


def slices(series: Path) -> Image.Image:
    """Twelve slices of a series from the head down, air black and 1000 HU white."""
    import pydicom

    files = sorted(map(pydicom.dcmread, series.iterdir()), key=lambda one: -one.ImagePositionPatient[2])
    some = files[len(files) // 20 :: max(len(files) // 13, 1)][:12]
    sheet = np.vstack([np.hstack([one.pixel_array for one in some[n : n + 4]]) for n in range(0, 12, 4)])
    values = sheet * float(files[0].RescaleSlope) + float(files[0].RescaleIntercept)
    return Image.fromarray(np.uint8(np.clip((values + 1000.0) * (255.0 / 2000.0), 0.0, 255.0)))


def crops() -> None:
    """readme-live.jpg and readme-slice.jpg: the views alone of two photographs of windows."""
    images = ROOT / "docs" / "images"
    for name, (source, part) in CROPS.items():
        shown = Image.open(images / f"{source}.jpg").crop(part)
        shown.thumbnail((700, 700), Image.Resampling.LANCZOS)
        save_jpeg(shown, images / f"{name}.jpg", MOST_BYTES)


def turn(folder: Path) -> None:
    """how-to-turn.webp: a brain under a sun and a world that turn with the camera; with the data folder alone."""
    if not (data_folder() / BRAIN).is_file():
        return
    volume = rs.read_volume(data_folder() / BRAIN)
    function = replace(rs.default_transfer_function(volume)[0], opacity_unit_distance=0.3)  # mm
    frames, cache = [], rs.StageCache()
    for azimuth in range(0, 360, 360 // TURN):
        camera, matrix = rs.turntable(volume, azimuth=azimuth, elevation=15, fit=1.15)
        toward = camera.matrix_world[:3, :3] @ ABOVE_LEFT
        scene = rs.Scene(
            volume, function, camera, PYTHON, PYTHON, volume_matrix=matrix, headlight=False,
            lights=(rs.Light(matrix_world=rs.look_at(toward, (0.0, 0.0, 0.0)), energy=3.0),), volume_shadows=True,
            world=(0.15, 0.15, 0.18), ambient_occlusion=1.0, antialias=True,
        )  # fmt: skip
        frames.append(on_gray(Image.fromarray(to_bytes(rs.render(scene, "fine", cache=cache).rgba), "RGBA")))
    frames[0].save(folder / "how-to-turn.webp", save_all=True, append_images=frames[1:], duration=MILLISECONDS, loop=0,
                   quality=70, method=6)  # fmt: skip


def effects(folder: Path) -> None:
    """how-to-effects.jpg: see ``effect_figure``; with the data folder alone."""
    from .effect_figure import make

    scans = [data_folder() / name for name in (BRAIN, SKULL)]
    if all(scan.exists() for scan in scans):
        beside(folder, "how-to-effects", make(*scans, folder / "bone.json"), 2 * MOST_BYTES, across=4)


def strip(folder: Path) -> None:
    """gallery-strip.jpg: slices of the skull, two steps of the tutorial, and the gallery's scene of the same scan."""
    if not (data_folder() / SKULL).is_dir():
        return
    pictures = {"Slices": slices(data_folder() / SKULL)}
    for caption, name, part in STEPS:
        pictures[caption] = Image.open(ROOT / "docs" / "images" / f"{name}.jpg").crop(part)
    pictures = {caption: one.convert("RGB").resize(STEP, Image.Resampling.LANCZOS) for caption, one in pictures.items()}
    beside(folder, "gallery-strip", pictures, 2 * MOST_BYTES, across=2)


def main() -> int:
    """Make the pictures in out/figures."""
    from rle_splat.cli.main import main as rle_splat

    FOLDER.mkdir(parents=True, exist_ok=True)
    code = max(map(rle_splat, command_lines(FOLDER)))
    if code == 0:
        from_parts(FOLDER)
    return code


if __name__ == "__main__":
    sys.exit(main())
