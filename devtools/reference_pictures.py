"""Reference pictures: every quality, classification and projection on scans and on scenes of effects.

Make them before a change that must not change pictures, and compare them after it:

    python dev.py reference make FOLDER
    python dev.py reference compare FOLDER

A folder holds one ``.npz`` file per picture: premultiplied rgba (H, W, 4) and depth (H, W), float32, or nothing where
the renderer refuses the combination.  Scans are used where the data folder is there.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np

from benchmarks.effects import given
from benchmarks.scenes import scenes as scans_of
from benchmarks.scenes import shells, smoke
from rle_splat import Quality, RleSplatError, Scene, encode, preset, read_encoded, render, turntable, write_encoded
from rle_splat.pipeline.shadow_pass import shadow_pass_steps
from rle_splat.runtime.jit import use_reference
from rle_splat.runtime.steps import drain
from rle_splat.scene import CLASSIFICATIONS, FOOTPRINTS, MODELS, QUALITY_PRESETS, RECORDS, WARP_FILTERS

SCANS = ("CT head", "MRI head", "CT engine", "X-ray foot", "CT bonsai")
# Name -> the prices of benchmarks.effects that the scene has, all at once.
EFFECT_SCENES = {
    "lights": ("lights",),
    "shadows": ("shadows", "ambient occlusion", "world light", "specular"),
    "mesh": ("lights", "mesh occlusion"),
    "mesh and mist": ("mesh occlusion", "mist"),
    "clip box": ("clip objects", "clipping"),
    "clip plane and mesh": ("clip plane", "mesh occlusion"),
    "lens": ("depth of field",),
    "shutter": ("motion blur",),
    "gradient opacity": ("gradient opacity", "shading"),
    "labels": ("labels", "clip plane"),
    "channels": ("channels", "shading"),
    "channels with labels": ("channels", "labels", "shading"),
    "x-ray": ("mode xray", "clipping"),
    "mip": ("mode mip",),
    "minip": ("mode minip",),
    "average": ("mode average", "clip objects"),
}
SIZES = {"scan": (256, 192), "effects": (160, 144), "numpy": (40, 32)}
VIEWS = {"scan": (35.0, 20.0), "effects": (-50.0, 35.0)}
FADING = (44.5, 0.0)  # azimuth and elevation within the fade between two principal axes


@dataclass(frozen=True, eq=False)
class Case:
    """A named picture to make: ``scene`` by ``quality``, or whatever ``draw`` returns instead."""

    name: str
    scene: Scene
    quality: Quality
    draw: object = None


def _seen(volume, function, view, size, perspective: bool, **more) -> Scene:
    width, height = size
    camera, matrix = turntable(volume, *view, perspective=perspective)
    return Scene(volume, function, camera, width, height, matrix, **more)


def _rungs() -> Iterator[tuple[str, Quality, bool]]:
    for name, classification, perspective in product(QUALITY_PRESETS, CLASSIFICATIONS, (False, True)):
        told = f"{name}-{classification}-{'persp' if perspective else 'ortho'}"
        yield told, Quality.preset(name, classification), perspective


def scan_cases() -> Iterator[Case]:
    for name, volume, function in scans_of(SCANS):
        for told, quality, perspective in _rungs():
            scene = _seen(volume, function, VIEWS["scan"], SIZES["scan"], perspective)
            yield Case(f"{name} {told}", scene, quality)


def effect_cases() -> Iterator[Case]:
    cloud, shell = (smoke((56, 60, 88)), preset("smoke")), shells(80)
    for name, prices in EFFECT_SCENES.items():
        volume, function = cloud if "mesh" in name or name in ("lens", "labels") else shell
        function = replace(function, shade=None)
        for told, quality, perspective in _rungs():
            scene = _seen(volume, function, VIEWS["effects"], SIZES["effects"], perspective, headlight=False)
            for price in prices:
                scene = given(scene, price)
            yield Case(f"{name} {told}", scene, quality)


def other_cases() -> Iterator[Case]:
    """What the ladder of qualities leaves out: single knobs, ready-made tables, the numpy reference."""
    volume, function = shells(80)
    for perspective in (False, True):
        told = "persp" if perspective else "ortho"
        scene = _seen(volume, function, VIEWS["effects"], SIZES["effects"], perspective)
        knobs = {
            "paper": Quality.paper(),
            "widen": Quality(classification="pre", minification="widen", sheet_density=0.25),
            "densest": Quality(sheet_density=4.0, depth_rule="midpoint-8"),
            **{f"kernel {kernel}": Quality(classification="pre", kernel=kernel) for kernel in FOOTPRINTS},
            **{f"record {size}": Quality(classification="pre", record=size) for size in RECORDS},
            **{f"model {model}": Quality(classification="pre", model=model) for model in MODELS},
            **{f"warp {warp}": Quality(warp_filter=warp) for warp in WARP_FILTERS},
        }
        for name, quality in knobs.items():
            yield Case(f"{name} {told}", scene, quality)
        yield Case(f"crop {told}", replace(scene, crop=(30, 20, 110, 90)), Quality.preset("fine"))
        for classification in CLASSIFICATIONS:
            quality = Quality(classification=classification)
            fading = _seen(volume, function, FADING, SIZES["effects"], perspective)
            yield Case(f"fade {classification} {told}", fading, quality)
            yield Case(f"cropped fade {classification} {told}", replace(fading, crop=(30, 20, 110, 90)), quality)
            small = _seen(*shells(24), VIEWS["effects"], SIZES["numpy"], perspective)
            for name in ("mesh occlusion", "clip objects", "lights"):
                told_numpy = f"numpy {name} {classification} {told}"
                yield Case(told_numpy, given(small, name), quality, _drawn_by_numpy)
        yield Case(f"file {told}", scene, Quality(classification="pre"), _drawn_from_file)
        yield Case(f"shadow pass {told}", given(scene, "mesh occlusion"), Quality(), _drawn_shadows)


def _drawn_by_numpy(scene: Scene, quality: Quality):
    with use_reference():
        rendering = render(scene, quality)
    return rendering.rgba, rendering.depth


def _drawn_from_file(scene: Scene, quality: Quality):
    """The picture of the scene's tables after a way through a ``.rle`` file."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "volume.rle"
        write_encoded(encode(scene, quality), path)
        stored = read_encoded(path)
    rendering = render(replace(scene, volume=stored, lights=(), headlight=False), quality)
    return rendering.rgba, rendering.depth


def _drawn_shadows(scene: Scene, quality: Quality):
    sun = given(scene, "lights")
    rendering, share = drain(shadow_pass_steps(replace(sun, volume_shadows=True), quality))
    return rendering.rgba, share


def cases(words) -> Iterator[Case]:
    """The cases whose name holds any of ``words``; all if there are none."""
    for family in (scan_cases, effect_cases, other_cases):
        for case in family():
            if not words or any(word in case.name for word in words):
                yield case


def drawn(case: Case) -> dict[str, np.ndarray]:
    """Arrays of a case's picture; none where it is refused."""
    try:
        if case.draw is not None:
            rgba, depth = case.draw(case.scene, case.quality)
        else:
            rendering = render(case.scene, case.quality)
            rgba, depth = rendering.rgba, rendering.depth
    except RleSplatError:
        return {}
    return {"rgba": rgba, "depth": depth}


def difference(was, now) -> float:
    """Largest absolute difference between two pictures; infinite where one is refused or has another shape."""
    if set(was) != set(now) or any(was[name].shape != now[name].shape for name in was):
        return float("inf")
    largest = 0.0
    for name in was:
        if was[name].tobytes() != now[name].tobytes():
            apart = np.abs(was[name].astype(np.float64) - now[name])
            largest = max(largest, float(np.nanmax(apart)), sys.float_info.min)
    return largest


def main(arguments=None) -> int:
    parser = argparse.ArgumentParser(prog="dev.py reference", description=__doc__.split("\n", 1)[0])
    parser.add_argument("action", choices=("make", "compare"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("words", nargs="*", help="only cases whose name holds one of these")
    known = parser.parse_args(arguments)
    known.folder.mkdir(parents=True, exist_ok=True)
    began, apart, count, refused = time.monotonic(), [], 0, 0
    for case in cases(known.words):
        path, now = known.folder / f"{case.name}.npz", drawn(case)
        count, refused = count + 1, refused + (not now)
        if known.action == "make":
            np.savez(path, **now)
            continue
        if not path.exists():
            print(f"{case.name}: not in the folder")
            apart.append(case.name)
            continue
        with np.load(path) as held:
            largest = difference(dict(held), now)
        if largest > 0.0:
            print(f"{case.name}: differs by up to {largest:.3g}", flush=True)
            apart.append(case.name)
    print(f"{count} pictures, {refused} of them refused, {len(apart)} differ; {time.monotonic() - began:.0f} s")
    return 1 if apart else 0


if __name__ == "__main__":
    sys.exit(main())
