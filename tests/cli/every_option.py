"""Command lines that together give every option of every command, with each of its values that is a name.

The options are taken from the parsers themselves: one that is missing in the tables here is an error.
"""

import argparse
import json
import os
from collections.abc import Iterator
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from rle_splat.classify.presets import PRESETS
from rle_splat.cli.images import writer_for
from rle_splat.cli.main import _build_parser, main
from rle_splat.pipeline.prepare import STORED_TYPES
from rle_splat.scene import MODES
from rle_splat.scene import quality as knobs

SIDE = 24  # voxels
LIT = "--lights lights.json --shadows"
LABELS = "--labels labels.raw --label-functions labels.json"
# Option -> values, each as its words.
VALUES = {
    "--size": ["30 20"], "--crop": ["5 5 25 20"], "--background": ["0 0.1 0", "white"], "--tile": ["16"],
    "--mode": MODES, "--mist": ["mist.json"], "--memory-limit": ["4GiB"], "--progress": [""], "--no-progress": [""],
    "--json": ["report.json"],
    "--byte-order": ["little"], "--header-bytes": ["0"], "--spacing": ["1 1.5 0.7"], "--orientation": ["LPS"],
    "--flip": ["xz"], "--slope": ["2.5"], "--intercept": ["-100"], "--level": ["1"], "--unit": ["mm"],
    "--value-unit": ["HU"], "--modality": ["CT", "MR"], "--transfer-function": ["function.json"],
    "--preset": PRESETS, "--transfer-name": ["other --transfer-function functions.xml"], "--smoothness": ["0", "3"],
    "--lights": ["lights.json"], "--headlight": [""], "--no-headlight": [""], "--no-shading": [""],
    "--azimuth": ["90"], "--elevation": ["90"], "--fit": ["2"], "--perspective": [""], "--fov": ["60 --perspective"],
    "--camera": ["camera.json"], "--volume-matrix": ["matrix.json"], "--scene-scale": ["0.01"],
    "--frames": ["1 2 --turn 40"], "--turn": ["90 --frames 1 2"], "--camera-path": ["cameras.json"],
    "--again": ["--frames 1 2 --turn 40"], "--motion": ["poses.json"],
    "--antialias": ["", "--perspective"], "--clip": ["clips.json"],
    "--light-recipe": ["three", "skin --smoothness 1", "smoke --ambient-occlusion 0.2"],
    "--shadows": ["--lights lights.json"], "--world": ["0.2 0.2 0.3"], "--environment": ["sky.exr"],
    "--ambient-occlusion": ["0.5"], "--indirect-light": [f"1 {LIT}"], "--shadow-pass": [f"pass.npy {LIT}"],
    "--labels": ["labels.raw --label-functions labels.json"],
    "--label-functions": ["labels.json --labels labels.raw --shadows --lights lights.json"],
    "--label-edges": [f"{edges} {LABELS}" for edges in ("smooth", "voxels")],
    "--keep-table": [""],
    "--channel": ["volume.raw --channel-function function.json"],
    "--channel-function": [f"function.json --channel volume.raw {more}" for more in (LIT, "--no-shading")],
    "--tolerance": ["4 --probes 20"], "--probes": ["20 --tolerance 8"],
    "--quality": knobs.QUALITY_PRESETS, "--paper": [""],
    "--classification": [*knobs.CLASSIFICATIONS, f"pre {LIT}"], "--depth-rule": knobs.DEPTH_RULES,
    "--sheet-density": ["0", "1.5"],
    "--kernel": knobs.FOOTPRINTS, "--minification": [f"{one} --sheet-density 0.3" for one in knobs.MINIFICATIONS],
    "--warp-filter": knobs.WARP_FILTERS, "--termination": ["0.01"], "--axis-fade": ["10 --azimuth 44"],
    "--rays": ["0.2"],
    "--model": knobs.MODELS, "--threads": ["1", "2"], "--record": list(map(str, knobs.RECORDS)), "--debug": [""],
    "--effect": [f"{name}=off" for name in ("shading", "gradient-opacity")],
}  # fmt: skip
# Options that have other values in a command.
OWN_VALUES = {
    "figure": {
        "--data": [],  # it wants a figure's sidecar in place of the volume
        "--width-cm": ["3"], "--dpi": ["60"], "--aspect": ["1.2"], "--columns": ["1"],
        "--background": ["black", "0 0 0.2"], "--font-size": ["7"], "--caption": ["text"],
        "--scale-bar": ["off", "10"], "--scale-depth": ["center --perspective"],
        "--sides": ["cube --orientation LPS", "off"],
        "--no-color-bar": [""], "--names": [LABELS], "--compare": ["ct-bone"], "--view": ["30 10"], "--title": ["text"],
    },
    "encode": {
        "--folder": [f"--classification {one} -o {one}.rle" for one in knobs.CLASSIFICATIONS], "--axes": ["x", "yz"],
        "--classification": ["pre"],
    },
    # It tries the same plans whatever they are, and takes seconds.
    "accuracy": {"--front": [], "--probes": [], "--repeats": []},
}  # fmt: skip
# What every command line of the command has.
COMMON = {
    "render": "volume.raw -o picture.npy", "info": "volume.raw", "figure": "volume.raw -o figure.png",
    "encode": "volume.raw -o volume.rle", "convert": "volume.raw volume.nrrd", "accuracy": "volume.raw",
}  # fmt: skip
SMALL = {"render": "--size 32", "figure": "--width-cm 3 --dpi 40", "accuracy": "--size 32 --probes 20 --repeats 1"}
# Of what the lines of "encode" have written: a file, and a folder of each classification.
ENCODED = ["volume.rle", *(f"{one}.rle" for one in knobs.CLASSIFICATIONS)]
VIEWS = ["", "--elevation 90", "--perspective", "--clip clips.json", "--quality fine"]
# In every command line; they choose what is read of other formats; they render elsewhere.
NOT_DRIVEN = (
    "--shape", "--dtype", "--output", "-o", "--help", "--help-all", "--grid", "--series", "--frame", "--like", "--dask",
    "--workers", "--slabs", "--file-channels",
)  # fmt: skip


def write_files(folder: Path, stored: str) -> None:
    """The files that the options name, of a soft ball of a stored type."""
    z, y, x = np.mgrid[:SIDE, :SIDE, :SIDE] - 0.5 * (SIDE - 1)
    ball = 250.0 * np.clip(1.2 - np.sqrt(x * x + y * y + z * z) / (0.5 * SIDE), 0.0, 1.0)
    ball.astype(stored).tofile(folder / "volume.raw")
    (ball > 120.0).astype(np.uint8).tofile(folder / "labels.raw")
    matrix = np.eye(4)
    matrix[:3, 3] = (-SIDE, -SIDE, 2 * SIDE)
    function = {
        "name": "function", "unit": None, "opacity": [[20, 0.0], [200, 0.6]],
        "color": [[0, 1.0, 0.2, 0.1], [255, 0.1, 0.4, 1.0]],
        "shade": {"ambient": 0.3, "diffuse": 0.7, "specular": 0.2, "shininess": 10},
    }  # fmt: skip
    camera = {"type": "ORTHO", "ortho_scale": 2.0 * SIDE, "matrix_world": matrix.tolist()}
    files = {
        "function": function, "labels": [{"label": 1, "name": "ball", "color": [0.0, 1.0, 0.0]}], "camera": camera,
        "cameras": [camera, camera], "matrix": np.diag((2.0, 1.0, 1.0, 1.0)).tolist(),
        "poses": [{"volume_matrix": np.eye(4).tolist()}, {"volume_matrix": matrix.tolist()}],
        "clips": [{"kind": "box", "matrix_world": np.diag((6.0, 6.0, 6.0, 1.0)).tolist(), "keep": "outside"},
                  {"kind": "plane", "matrix_world": np.eye(4).tolist(), "keep": "inside"}],
        "lights": [{"type": "POINT", "color": [1.0, 1.0, 1.0], "energy": 1e4, "matrix_world": matrix.tolist()},
                   {"type": "SUN", "color": [1.0, 0.5, 0.2], "energy": 2.0, "matrix_world": matrix.tolist()}],
        "mist": {"start": 5.0, "depth": 40.0, "falloff": "LINEAR", "color": [0.5, 0.5, 0.5]},
    }  # fmt: skip
    for name, content in files.items():
        (folder / f"{name}.json").write_text(json.dumps(content))
    (folder / "functions.xml").write_text(
        '<MRML><VolumeProperty name="other" shade="1" scalarOpacity="4 60 0 200 0.5" gradientOpacity="4 0 1 255 1" '
        'colorTransfer="4 0 1 0 0"/></MRML>'
    )
    writer_for("sky.exr")(folder / "sky.exr", np.ones((4, 8, 4), np.float32), None)


def options_of(command: str) -> Iterator[str]:
    """Every option that the parser of a command has and its help shows."""
    (commands,) = (one for one in _build_parser(command)._actions if isinstance(one, argparse._SubParsersAction))
    for action in commands.choices[command]._actions:
        if action.help != argparse.SUPPRESS:
            yield from (name for name in action.option_strings if name.startswith("--") or name == "-o")


def command_lines() -> Iterator[tuple[str, str]]:
    """Command and words of each line, one without options for each command; a KeyError for an option that no table has.

    An option that several commands share is driven in the first of them.
    """
    seen = set(NOT_DRIVEN)
    for command, words in COMMON.items():
        yield command, words
        own = OWN_VALUES.get(command, {})
        for option in options_of(command):
            values = own[option] if option in own else () if option in seen else VALUES[option]
            seen.add(option)
            yield from ((command, f"{words} {option} {value}") for value in values)
    yield from (("render", f"{name} -o picture.npy {view}") for name in ENCODED for view in VIEWS)


def run_all(begin) -> list[str]:
    """Run all command lines in this process, each with one of the stored types in turn, in a folder of files that is
    removed; returns what went wrong.

    ``begin(line)``: called before each, with its words; returns a context in which the line runs.
    """
    wrong, here = [], os.getcwd()
    with TemporaryDirectory() as name:
        try:
            for turn, stored in enumerate(STORED_TYPES):
                folder = Path(name, stored)
                folder.mkdir()
                os.chdir(folder)
                write_files(folder, stored)
                for number, (command, words) in enumerate(command_lines()):
                    if (number + turn) % len(STORED_TYPES) and command != "encode":  # whose files others read
                        continue
                    raw = f"--shape {SIDE} {SIDE} {SIDE} --dtype {stored}" if "volume.raw" in words else ""
                    line = f"{command} {words} {raw} {SMALL.get(command, '')}"
                    with begin(line), redirect_stdout(StringIO()) as printed, redirect_stderr(printed):
                        code = main(line.split())
                    if code:
                        wrong.append(f"{line}: {printed.getvalue()}")
        finally:
            os.chdir(here)
    return wrong
