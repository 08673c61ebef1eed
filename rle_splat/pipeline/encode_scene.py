"""Encode a scene: its volume classified, shaded and run-length encoded, ready for a ``.rle`` file."""

from collections.abc import Generator, Sequence

from ..effects.analyze import analyze_effects
from ..encode.stored import StoredVolume
from ..runtime.steps import Clock, Progress, announce, drain
from ..scene import Quality, QualityName, Scene, as_quality
from ..scene.plain import plain
from ..view.projection import depth_row
from ..volume.axes import AXES, AXIS_NAMES
from .lighting import eye_of
from .scan_source import make_scan_source
from .source import Work
from .stage_cache import StageCache


def encode(
    scene: Scene, quality: Quality | QualityName | None = None, axes: Sequence[int] = tuple(AXES), source: str = ""
) -> StoredVolume:
    """Classify, shade and encode the volume of a scene.

    Parameters
    ----------
    scene : Scene
        Its volume, transfer function and light count.
    quality : Quality or str, optional
        As ``render`` takes it. Left out, "standard". Its model, record and threads count; tables always hold
        pre-classified voxels.
    axes : sequence of int
        Principal axes to encode, 0, 1, 2 for x, y, z.
    source : str
        Name of the file that the volume was read from, for whoever opens the result.

    Returns
    -------
    StoredVolume
        Can be saved, and rendered as a volume.
    """
    return drain(encode_steps(scene, quality, axes, source))[0]


def encode_steps(
    scene: Scene, quality: Quality | QualityName | None = None, axes: Sequence[int] = tuple(AXES), source: str = ""
) -> Generator[Progress, None, tuple[StoredVolume, dict]]:
    """Generator form of ``encode``: yields Progress, returns (StoredVolume, report)."""
    quality = as_quality(quality).classified("pre")
    scene = analyze_effects(scene, quality)[1]
    clock = Clock()
    scan, work = make_scan_source(scene, quality), Work(StageCache(0).job(), clock, len(axes))
    lit = (yield from scan.medium_steps(work)).voxels
    classified = lit.classified
    encoded, begun, share = {}, 0.1, 0.9 / len(axes)
    for axis in sorted(axes, reverse=True):  # the others take the records of z, so that all is shaded once
        steps = lit.encode_steps(axis)
        encoded[axis] = yield from announce(steps, begun, begun + share, f"Encoding along {AXIS_NAMES[axis]}")
        begun += share
    encoded = {axis: encoded[axis] for axis in axes}
    volume = scene.volume
    stored = StoredVolume.of(
        encoded, volume.affine, volume.unit, classified.unit_length, scene.transfer_function.to_json(),
        describe_lighting(scene), source, tuple(volume.remarks), volume.space,
    )  # fmt: skip
    spent = clock.report()
    report = {
        "stages_ms": {name: spent[name] for name in ("classify", "shade", "encode", "total")},
        "volume": {
            "shape_xyz": list(volume.shape_xyz),
            "visible_voxels": classified.visible_voxels,
            "visible_fraction": classified.visible_fraction,
            "nan_voxels": classified.nan_voxels,
        },
        "model": quality.model,
        "record": quality.record,
        "memory_estimate_bytes": lit.estimate.report(),
        "axes": {
            AXIS_NAMES[axis]: {
                "runs": len(tables.runs),
                "memory_bytes": {**tables.table_bytes, "total": tables.nbytes},
            }
            for axis, tables in encoded.items()
        },
    }
    return stored, report


def describe_lighting(scene: Scene) -> dict:
    """JSON-ready: what the lit colors of a scene depend on besides the volume and the transfer function.

    ``headlight_direction``: along which a headlight shines, None without one.  ``eye``: homogeneous world position of
    the eye, for highlights.  ``environment``: moments of the world's light by name.
    """
    looking, eye = depth_row(scene.camera)[:3], eye_of(scene.camera)
    return {
        "shaded": scene.transfer_function.shade is not None and scene.shines,
        "lights": plain(scene.lights), "headlight_direction": looking.tolist() if scene.headlight else None,
        "eye": eye.tolist(), "world": plain(scene.world), "environment": plain(scene.environment),
    }  # fmt: skip
