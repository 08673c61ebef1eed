"""Which image datablocks a volume's pictures go to, and how a finished picture gets there."""

from __future__ import annotations

import json

import bpy

from ..rle_splat.cost_of_accuracy import TRUTH_TEXTS
from ..rle_splat.single_rays import rays_lines
from . import effects, images

LONGEST_NAME = 40  # characters of the object's name that an image's name keeps; Blender 4.5 cuts names at 63
SUFFIXES = {
    "color": "Splat", "depth": "Splat Depth", "backdrop": "Splat Backdrop", "composite": "Splat Composite",
    "error": "Splat Error", "shadow": "Splat Shadow",
}  # fmt: skip
NUMBERS = ("depth", "error", "shadow")  # kinds that hold numbers, not colours


def name_of(volume_object, kind: str) -> str:
    """What the volume's image of that kind, a key of SUFFIXES, is called."""
    return f"{volume_object.name[:LONGEST_NAME]} {SUFFIXES[kind]}"


def find(volume_object, kind: str):
    """The volume's image of that kind, or None."""
    existing = bpy.data.images.get((name_of(volume_object, kind), None))
    if existing is not None and images.MARK not in existing:
        return None  # the user's own picture of that name is left alone
    return existing


def find_or_make(volume_object, kind: str, width: int, height: int):
    """The volume's image of that kind: the one of last time, or a new one."""
    existing, name = find(volume_object, kind), name_of(volume_object, kind)
    return images.ensure_image(existing, name, width, height, depth=kind in NUMBERS)


def keep(volume_object, rgba, depth, *, kind: str = "color"):
    """Write a picture and its depth into the volume's images, packed; returns (image, depth image)."""
    height, width = depth.shape
    image = find_or_make(volume_object, kind, width, height)
    images.write_color(image, rgba)
    images.pack(image)
    return image, keep_numbers(volume_object, depth, "depth")


def show(image, rendering) -> None:
    """Write a rendering into an image of ours, resized to it where need be."""
    height, width = rendering.depth.shape
    images.write_color(images.ensure_image(image, image.name, width, height), rendering.rgba)


def keep_numbers(volume_object, numbers, kind: str):
    """Write (H, W) numbers into the volume's image of that kind, one of NUMBERS, packed; returns the image."""
    height, width = numbers.shape
    image = find_or_make(volume_object, kind, width, height)
    images.write_numbers(image, numbers)
    images.pack(image)
    return image


def _error_lines(report: dict) -> list[str]:
    """What is known of a picture's error, and against which truth."""
    error = report.get("error", {})
    if error.get("truth") not in TRUTH_TEXTS:
        return []
    against = f"against {error['truth']}, {TRUTH_TEXTS[error['truth']]}"
    if error["tolerance"] is None:
        return [f"Not measured; its errors are {against}"]
    return [f"Error in levels: {error['sentence']}, {against}", error.get("statement", ""), report["plan"]["name"]]


def note_report(settings, report: dict) -> None:
    """Keep what a picture took in the scene's settings, for people and for machines."""
    stages = report.get("stages_ms", {})
    lines = [f"{name.replace('_', ' ')}: {value:.0f} ms" for name, value in stages.items()
             if isinstance(value, (int, float))]
    settings.last_report = "\n".join((
        *report.get("remarks", ()), *_error_lines(report), *rays_lines(report.get("rays")), *lines
    ))
    settings.last_report_json = json.dumps(report, default=str)
    effects.note_report(settings, report)
