"""The sidecar of a figure: everything from which it is made again, bit for bit, as JSON.

It holds the names of files as the user gave them and hashes of their data, and nothing that a file says about a
patient.
"""

import hashlib
import platform
from dataclasses import MISSING, asdict, dataclass, fields
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np

from ..classify.transfer_function import TransferFunction
from ..encode.members import LIGHT_MODEL
from ..runtime.cache_folder import RELEASE
from ..scene import (
    Camera,
    Clip,
    Environment,
    Light,
    Mist,
    Pose,
    Quality,
    RleSplatError,
    Scene,
    from_mapping,
    read_json,
    without_removed,
)
from ..scene.plain import plain
from .make import MadeFigure
from .plan import Figure, FigureStyle, Name, Panel
from .sources import FURTHER, FigureData, Sources, further_json, further_of, part, sources_json, sources_of

FORMAT, VERSION = "rle-splat figure", 1
AS_MADE = "figure"  # name of a quality whose knobs are those of a sidecar
PACKAGES = ("numpy", "numba")
OF_THE_MACHINE = ("threads",)  # knobs that no bit depends on
NOT_HELD = ("volume", "background", "reasons_off")  # fields of a scene that are elsewhere, or without effect
NEEDED = ("transfer_function", "camera", "width", "height")
# Field of a scene -> from JSON to its value.
HELD = {
    "transfer_function": TransferFunction.from_json,
    "camera": lambda given: from_mapping(Camera, given, "The sidecar's camera"),
    "width": int, "height": int, "volume_matrix": np.array, "scene_scale": float,
    "lights": lambda given: tuple(from_mapping(Light, one, "A light of the sidecar") for one in given),
    "headlight": bool, "effects": dict,
    "motion": lambda given: tuple(from_mapping(Pose, one, "A pose of the sidecar") for one in given),
    "clips": lambda given: tuple(from_mapping(Clip, one, "A cutting object of the sidecar") for one in given),
    "mode": str, "antialias": bool,
    "mist": lambda given: from_mapping(Mist, given, "The sidecar's mist"), "volume_shadows": bool,
    "world": tuple, "environment": lambda given: from_mapping(Environment, given, "The sidecar's environment"),
    "ambient_occlusion": float, "indirect_light": float,
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Sidecar:
    """A sidecar that was read.

    Attributes
    ----------
    content : dict
        The whole file.
    """

    sources: Sources
    content: dict


# --- writing ----------------------------------------------------------------------------------------------------------


def sidecar_of(made: MadeFigure, sources: Sources) -> dict:
    """The sidecar of a figure, JSON-ready.

    Parameters
    ----------
    sources : Sources
        Of its volume, and of the labels and channels that it shows.

    Returns
    -------
    dict
        ``missing`` names what of the scene it does not hold; a figure with any of it cannot be made again from it.
    """
    scenes = [panel.scene for panel in made.figure.panels]
    return {
        "format": FORMAT,
        "version": VERSION,
        "versions": versions(),
        "light": LIGHT_MODEL,
        **sources_json(sources, scenes[0]),
        "style": asdict(made.figure.style),
        "panels": [
            _panel(panel, rendering) for panel, rendering in zip(made.figure.panels, made.renderings, strict=True)
        ],
        "missing": sorted({name for scene in scenes for name in missing_of(scene)}),
    }


def _panel(panel: Panel, rendering) -> dict:
    plan = rendering.report["plan"]
    known = {entry.name for entry in fields(Quality)} - {*OF_THE_MACHINE, "held"}
    return {
        "title": panel.title,
        "names": [plain(asdict(one)) for one in panel.names],
        "scene": {**{name: _field(panel.scene, name) for name in HELD}, **further_json(panel.scene)},
        "quality": {**{name: plan[name] for name in plan if name in known}, "name": AS_MADE},
        "plan": plain({name: plan[name] for name in ("quality", "why", "aim", "expected", "base_planes")}),
        "error": plain(rendering.report["error"]),
        "pixels": pixel_hash(rendering.rgba),
    }


def _field(scene: Scene, name: str):
    value = getattr(scene, name)
    return value.to_json() if isinstance(value, TransferFunction) else plain(value)


def missing_of(scene: Scene) -> list[str]:
    """Names of the fields of a scene that a sidecar does not hold, and that are not at their defaults."""
    others = (entry for entry in fields(Scene) if entry.name not in (*HELD, *FURTHER, *NOT_HELD))
    return [entry.name for entry in others if not _is_default(getattr(scene, entry.name), entry)]


def _is_default(value, entry) -> bool:
    usual = entry.default if entry.default_factory is MISSING else entry.default_factory()
    return value is usual or (type(value) is type(usual) and not isinstance(value, np.ndarray) and value == usual)


def pixel_hash(rgba: np.ndarray) -> str:
    """Hash of a picture's bits."""
    digest = hashlib.blake2b(repr(rgba.shape).encode(), digest_size=16)
    digest.update(np.ascontiguousarray(rgba, np.float32))
    return digest.hexdigest()


def versions() -> dict[str, str]:
    """Versions of what a picture's bits may depend on."""
    found = {"rle-splat": RELEASE}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "unknown"
    return {**found, "python": platform.python_version(), "machine": platform.machine()}


# --- reading ----------------------------------------------------------------------------------------------------------


def read_sidecar(path) -> Sidecar:
    """Read a sidecar.

    Parameters
    ----------
    path : path-like

    Raises
    ------
    RleSplatError
        For a file that is no sidecar, one of a later version, or one that does not hold the whole scene.
    """
    content = read_json(path, "the sidecar")
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise RleSplatError(f"{path} is not the sidecar of a figure; give one that was written beside a figure.")
    if content.get("version") != VERSION:
        raise RleSplatError(
            f"The sidecar {path} has version {content.get('version')!r}, and this program reads version {VERSION}; use "
            "the program that made it."
        )
    missing = part(content, "missing", list, path)
    if missing:
        names = ", ".join(str(name).replace("_", " ") for name in missing)
        raise RleSplatError(
            f"The figure of {path} shows more than its sidecar can hold ({names}); make it again where it was made."
        )
    sources = sources_of(content, path)
    for panel in part(content, "panels", list, path):
        if not isinstance(panel, dict):
            raise RleSplatError(f"A panel of the sidecar {path} is not an object; use the file as it was written.")
        for name, kind in (("title", str), ("scene", dict), ("quality", dict), ("pixels", str)):
            part(panel, name, kind, path)
        part({"names": [], **panel}, "names", list, path)
    part(content, "style", dict, path)
    return Sidecar(sources, content)


def figure_of(sidecar: Sidecar, data: FigureData, threads: int = 0) -> tuple[Figure, list[Quality]]:
    """The figure of a sidecar, and the qualities of its panels; RleSplatError for values that are out of range.

    Parameters
    ----------
    data : FigureData
        See ``check_data``.
    threads : int
        As of Quality.
    """
    panels, qualities = [], []
    for entry in sidecar.content["panels"]:
        names = tuple(from_mapping(Name, one, "A name of the sidecar") for one in entry.get("names", ()))
        panels.append(Panel(_scene(entry["scene"], data), entry["title"], names))
        knobs, _ = without_removed({**entry["quality"], "threads": threads})
        qualities.append(from_mapping(Quality, knobs, "The sidecar's quality"))
    style = from_mapping(FigureStyle, sidecar.content["style"], "The sidecar's style")
    return Figure(tuple(panels), style), qualities


def _scene(given: dict, data: FigureData) -> Scene:
    """The scene of a panel; fields that a sidecar of an earlier version does not have yet are at their defaults."""
    wrong = [name for name in given if name not in (*HELD, *FURTHER)] + [name for name in NEEDED if name not in given]
    if wrong:
        raise RleSplatError(f"The scene of the sidecar has an unknown or no {wrong[0]!r}; use the file as written.")
    try:
        values: dict[str, Any] = {
            name: None if value is None else HELD[name](value) for name, value in given.items() if name in HELD
        }
        values.update(further_of(given, data))
    except (TypeError, ValueError, KeyError) as problem:
        raise RleSplatError(f"The scene of the sidecar has a value of the wrong type: {problem}.") from None
    return Scene(volume=data.volume, **values)


def version_remarks(sidecar: Sidecar) -> list[str]:
    """Sentences on versions that differ from those with which a figure was made, and on what they no longer have."""
    now, given = versions(), sidecar.content.get("versions")
    made = given if isinstance(given, dict) else {}
    panels = sidecar.content["panels"]
    removed = [sentence for entry in panels for sentence in without_removed(entry["quality"])[1]]
    return [*dict.fromkeys(removed)] + [
        f"The figure was made with {name} {made[name]}, and this is {name} {now[name]}; its bits may differ."
        for name in now if name in made and made[name] != now[name]
    ]  # fmt: skip


def same_bits(sidecar: Sidecar, renderings) -> bool:
    """Whether the pictures of a figure that was made again are bit-identical to those of the sidecar."""
    recorded = [entry["pixels"] for entry in sidecar.content["panels"]]
    return recorded == [pixel_hash(rendering.rgba) for rendering in renderings]
