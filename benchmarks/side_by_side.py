"""Pictures of this program, of VTK's CPU ray caster and of Cycles' own volume side by side, with the seconds of each.

Each program draws in the environment that has it, and keeps its pictures; then they are joined to one sheet:

    .venvs/bpy-5.2/bin/python -m benchmarks.side_by_side cycles --seconds 60
    .venv/bin/python -m benchmarks.side_by_side ours
    .venvs/bench/bin/python -m benchmarks.side_by_side vtk
    .venvs/bench/bin/python -m benchmarks.side_by_side vtk-smoothed
    .venvs/bench/bin/python -m benchmarks.side_by_side join sheet.jpg

    .venvs/bench/bin/python -m benchmarks.side_by_side presets sheet.jpg

makes a sheet of presets on scans of three modalities, ``crops`` one of parts of the joined pictures, twice as large.
Camera, transfer function and sun are the same.  Ours has shadows and ambient occlusion, at ``fine``.  VTK has four
samples per voxel, no shadows, and for the light of the world the ambient term of its material.  It takes normals of no
volume but that which it shows, so ``vtk-smoothed`` shows what our normals are made of: values, smoothed.  Cycles
scatters light in a Principled Volume of the unlit colors; its picture is made as bright as ours, by one factor.
Seconds are of the processor, one thread, from the voxels in memory on, kernels loaded.
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from devtools.sheets import sheet
from rle_splat.classify.presets import fit_preset
from rle_splat.classify.transfer_function import Shade, TransferFunction
from rle_splat.pipeline.render import render
from rle_splat.read.formats import read_volume
from rle_splat.runtime.steps import drain
from rle_splat.scene import Light, Quality, Scene
from rle_splat.view.turntable import turntable
from rle_splat.volume.volume import Volume

from .lamps import shining
from .scenes import DATA

FOLDER = Path("out") / "side-by-side"
SIZE, SAMPLES, BOUNCES, PILOT = 360, 4, 4, 4  # pixels, VTK's samples per voxel, Cycles' bounces and first samples
WORLD, OCCLUSION = 0.15, 0.8
LAMP = (0.55, -0.6, -0.58)  # where the sun shines to, in the camera's axes: from above, on the left
ENERGY = 3.2
FILLED, FAINT, SOFT = 0.9, 0.02, 0.3  # of presets: part of the picture, least opacity that counts, light of the world
BRIGHT = 0.9  # quantile of what is seen that is made equal

NUCLEI = TransferFunction(
    "nuclei", None, ((9000.0, 0.0), (20000.0, 0.9)), ((9000.0, 0.15, 0.45, 0.5), (40000.0, 0.6, 0.9, 0.75)), 0.29,
    Shade(0.15, 0.75, 0.25, 25.0),
)  # fmt: skip

# The color of CT Bone, from half of what the plastic of the phantom has, about 750 HU, in air.
PLASTIC = TransferFunction(
    "plastic", "HU", ((-300.0, 0.0), (0.0, 0.9)), ((-300.0, 0.83, 0.74, 0.58), (700.0, 0.85, 0.77, 0.62)), None,
    Shade(0.12, 0.84, 0.12, 24.0),
)  # fmt: skip


@dataclass(frozen=True)
class Subject:
    """A scan: its file, its preset or transfer function, azimuth and elevation, the view's fit, how it is read, whether
    its first slice is on top, so that it is turned about X, whether what lies beside the body is left out, and the
    smallest value of the largest part that alone is kept, with a margin."""

    file: str
    function: str | TransferFunction
    view: tuple
    fit: float = 1.1
    options: dict = field(default_factory=dict)
    turned: bool = False
    alone: bool = False
    kept_from: float | None = None


HEAD = dict(spacing=(1.0, 1.0, 2.0)), True
ALONE = {}, False, True
CT_HEAD = "cthead_256x256x113_uint16be.raw.gz"
CHEST = "dicom_ct_chest_cta_512x512x95"
HEART = "cta_aorta_labels/cta_heart_aorta_120x126x164_int16.nii.gz"
SUBJECTS = {
    "CT head": Subject(CT_HEAD, "ct-skin", (215, 10), 0.95, *HEAD, True),
    "skull phantom": Subject("dicom_ct_skull_phantom_512x512x140", PLASTIC, (35, 15), 0.95, *ALONE),
    "chest angiography": Subject(CHEST, "ct-angiography", (20, 20), 1.0, *ALONE),
    "MR brain": Subject("mrbrain_256x256x99_uint8.raw.gz", "mr-brain", (160, 35), 0.95, *HEAD),
    "nuclei": Subject("fluorescence/nuclei_256x256x60_uint16.tif", NUCLEI, (20, 55), 1.0),
    "smoke": Subject("smoke_fog.vdb", "smoke", (30, 5), 1.05),
}
# Presets on scans of three modalities.
PRESETS = {
    "CT skull: Bone": Subject("dicom_ct_skull_phantom_512x512x140", "ct-bone", (30, 0), 0.9, *ALONE),
    "CT heart: Angio": Subject(HEART, "ct-angiography", (50, 8), 1.1, kept_from=130.0),
    "CT chest: Soft Tissue": Subject(CHEST, "ct-soft-tissue", (15, -50), 1.08, *ALONE),
    "CT chest: Lung": Subject(CHEST, "ct-lung", (0, -65), 1.16, *ALONE),
    "MR T1: Head": Subject("t1_head_188x256x190_uint8.nii.gz", "mr-head", (35, 10), 1.1),
    "MR FLAIR: Brain": Subject("flair_brain_124x160x140_uint8.nrrd", "mr-brain", (35, 25), 1.0),
    "PET: Hot": Subject("pet_seg/dicom_pet_128x128x266", "pet-hot", (0, 0), 0.85),
    "CT engine: Industrial": Subject("engine_256x256x110_uint8.raw.gz", "ct-industrial", (-30, 20), 1.0),
    "CT lobster: Specimen": Subject("lobster_301x324x56_uint8.raw.gz", "ct-specimen", (25, 55), 0.98,
                                    dict(spacing=(1.0, 1.0, 1.4)), kept_from=40.0),
}  # fmt: skip
CROP = 120  # pixels
CROPS = {  # part -> subject, left, top
    "crown": ("CT head", 150, 5), "temple": ("CT head", 90, 90), "skull": ("skull phantom", 110, 60),
    "rib": ("chest angiography", 230, 120), "heart": ("chest angiography", 80, 110), "gyrus": ("MR brain", 60, 90),
}  # fmt: skip
PROGRAMS = "ours", "vtk", "vtk-smoothed", "cycles"


def read(subject: Subject) -> Volume:
    """The subject's volume; an OpenVDB file as Cycles' turn has kept it, and a body as the first program's has."""
    path = DATA / subject.file
    if path.suffix != ".vdb":
        volume = read_volume(path, **subject.options)
        if subject.turned:
            volume = replace(volume, voxels=np.ascontiguousarray(volume.voxels[::-1, ::-1]))
        if subject.kept_from is not None:
            return _largest(volume, subject.kept_from)
        return _alone(volume, FOLDER / f"{path.name}.body.npy") if subject.alone else volume
    kept = FOLDER / "smoke.npz"
    if not kept.exists():
        volume = read_volume(path)
        upright = np.ascontiguousarray(volume.voxels.transpose(1, 0, 2)[:, ::-1])  # in the file Y points up
        np.savez(kept, voxels=upright, affine=np.diag((*volume.spacing[[0, 2, 1]], 1.0)))
    with np.load(kept) as found:
        return Volume(found["voxels"], found["affine"])


def _alone(volume: Volume, kept: Path) -> Volume:
    """The volume with its lowest value wherever its body, which is kept in a file, is not."""
    if not kept.exists():
        from rle_splat.segment.body import body_steps

        kept.parent.mkdir(parents=True, exist_ok=True)
        np.save(kept, drain(body_steps(volume)))
    return replace(volume, voxels=np.where(np.load(kept), volume.voxels, volume.voxels.min()))


def _largest(volume: Volume, low: float) -> Volume:
    """The largest part of the values from ``low`` on, and two voxels around it: Keep Largest, then Grow."""
    from rle_splat.segment.masks import grow_steps, keep_largest_steps

    part = drain(keep_largest_steps(volume.physical(volume.voxels) >= low))
    part = drain(grow_steps(part, volume.spacing, 2.0 * volume.spacing.min()))
    return replace(volume, voxels=np.where(part, volume.voxels, volume.voxels.min()))


def scene_of(subject: Subject, size: int) -> Scene:
    """The subject under a sun from above on the left of the camera, in a dim world; so many pixels wide and high."""
    volume = read(subject)
    function = subject.function if isinstance(subject.function, TransferFunction) else fit_preset(
        subject.function, volume
    )[0]  # fmt: skip
    if function.shade is None:
        function = replace(function, shade=Shade())
    camera, matrix = turntable(volume, *subject.view, subject.fit, True, 25.0)
    sun = Light(energy=ENERGY, matrix_world=shining(camera.matrix_world[:3, :3] @ LAMP))
    return Scene(
        volume, function, camera, size, size, matrix, lights=(sun,), headlight=False, volume_shadows=True,
        world=(WORLD,) * 3, ambient_occlusion=OCCLUSION,
    )  # fmt: skip


def draw_ours(scene: Scene, _) -> tuple:
    """(rgba, seconds): at ``fine``, the first picture of a volume in memory."""
    quality = Quality.preset("fine", threads=1)
    render(replace(scene, width=32, height=32), quality)  # loads the kernels
    began = time.process_time()
    return render(scene, quality).rgba, time.process_time() - began


def draw_vtk(scene: Scene, _) -> tuple:
    """(rgba, seconds): with the sun, without shadows."""
    from .vtk_caster import VtkCaster

    began = time.process_time()
    caster = VtkCaster(scene, True, 1, SAMPLES, -scene.lights[0].matrix_world[:3, 2])
    rgba, _ = caster.draw(scene)
    spent = time.process_time() - began
    caster.close()
    return rgba, spent


def draw_vtk_smoothed(scene: Scene, _) -> tuple:
    """(rgba, seconds): as ``draw_vtk``, of the values that our normals are made of; without the time of smoothing."""
    from rle_splat.accuracy.light_normals import automatic_sigma, smooth

    volume, sigma = scene.volume, scene.transfer_function.shade.smoothness
    sigma = automatic_sigma(volume.affine) if sigma is None else sigma
    smoothed = smooth(volume.voxels.astype(np.float64), sigma, volume.spacing).astype(np.float32)
    return draw_vtk(replace(scene, volume=replace(volume, voxels=smoothed)), _)


def draw_cycles(scene: Scene, seconds: float) -> tuple:
    """(rgba, seconds): Cycles for about so many seconds of the processor, loading the grid included."""
    import bpy

    bpy.ops.wm.read_factory_settings(use_empty=True)
    path = FOLDER.resolve() / f"{scene.volume.key}.vdb"  # Blender keeps the grids of a path
    _write_medium(scene, path)
    data = bpy.data.volumes.new("medium")
    data.filepath = str(path)
    data.materials.append(_scattering_material(bpy))
    blender = bpy.context.scene
    blender.collection.objects.link(bpy.data.objects.new("medium", data))
    _place(bpy, scene)
    blender.render.engine, blender.render.film_transparent = "CYCLES", True
    blender.render.resolution_x, blender.render.resolution_y = scene.width, scene.height
    blender.render.threads_mode, blender.render.threads = "FIXED", 1
    cycles = blender.cycles
    cycles.device, cycles.use_denoising, cycles.volume_bounces = "CPU", False, BOUNCES
    cycles.use_adaptive_sampling = False
    image = blender.render.image_settings
    image.file_format, image.color_mode, image.color_depth = "OPEN_EXR", "RGBA", "32"
    blender.render.filepath = str(path.with_suffix(".exr"))

    def rendered(samples: int) -> float:
        cycles.samples = samples
        began = time.process_time()
        bpy.ops.render.render(write_still=True)
        return time.process_time() - began

    rendered(1)  # loads Cycles' kernels
    loading, pilot = rendered(1), rendered(1 + PILOT)
    spent = rendered(1 + max(round(PILOT * (seconds - loading) / (pilot - loading)), 1))
    print(f"  {cycles.samples} samples")
    loaded = bpy.data.images.load(blender.render.filepath)
    rgba = np.empty((scene.height, scene.width, 4), np.float32)
    loaded.pixels.foreach_get(rgba.reshape(-1))
    return rgba[::-1].copy(), spent


def _write_medium(scene: Scene, path: Path) -> None:
    """The extinction and unlit colors of the scene as OpenVDB grids, in its world."""
    from rle_splat.pipeline.medium_grid import medium_steps
    from rle_splat.read.vdb_medium import MediumFile

    unlit = replace(
        scene, transfer_function=replace(scene.transfer_function, shade=None), lights=(), world=None,
        volume_shadows=False, ambient_occlusion=0.0,
    )  # fmt: skip
    made = MediumFile()
    drain(medium_steps(unlit, Quality(threads=1), (1, 1, 1), made.add), None)
    made.save(path, scene.index_to_world)


def _scattering_material(bpy):
    """A Principled Volume of the file's extinction and of emission over extinction, its color."""
    material = bpy.data.materials.new("medium")
    tree = material.node_tree
    tree.nodes.clear()
    density, emission = (tree.nodes.new("ShaderNodeAttribute") for _ in range(2))
    density.attribute_name, emission.attribute_name = "density", "emission"
    divide, principled, output = (
        tree.nodes.new(f"ShaderNode{kind}") for kind in ("VectorMath", "VolumePrincipled", "OutputMaterial")
    )
    divide.operation = "DIVIDE"
    principled.inputs["Density Attribute"].default_value = ""  # else it would be multiplied in once more
    tree.links.new(emission.outputs["Vector"], divide.inputs[0])
    tree.links.new(density.outputs["Fac"], divide.inputs[1])
    tree.links.new(density.outputs["Fac"], principled.inputs["Density"])
    tree.links.new(divide.outputs["Vector"], principled.inputs["Color"])
    tree.links.new(principled.outputs[0], output.inputs["Volume"])
    return material


def _place(bpy, scene: Scene) -> None:
    """The scene's camera, sun and world in Blender."""
    from mathutils import Matrix

    blender, given = bpy.context.scene, scene.camera
    lens = bpy.data.cameras.new("camera")
    lens.lens, lens.sensor_fit, lens.sensor_height = given.lens, given.sensor_fit, given.sensor_height
    lens.sensor_width, lens.clip_start, lens.clip_end = given.sensor_width, given.clip_start, given.clip_end
    sun = bpy.data.lights.new("sun", "SUN")
    sun.energy, sun.angle = scene.lights[0].energy, 0.0
    for data, matrix in ((lens, given.matrix_world), (sun, scene.lights[0].matrix_world)):
        placed = bpy.data.objects.new(data.name, data)
        blender.collection.objects.link(placed)
        placed.matrix_world = Matrix(matrix.tolist())
        if data is lens:
            blender.camera = placed
    blender.world = bpy.data.worlds.new("world")
    blender.world.node_tree.nodes["Background"].inputs["Color"].default_value = (*scene.world, 1.0)


DRAW = {
    "ours": draw_ours, "vtk": draw_vtk, "vtk-smoothed": draw_vtk_smoothed, "cycles": draw_cycles,
}  # fmt: skip
TITLES = {
    "ours": "RLE Splat, shadows", "vtk": "VTK (CPU), no shadows", "vtk-smoothed": "VTK smoothed, no shadows",
    "cycles": "Cycles",
}  # fmt: skip


def draw(program: str, names, seconds: float, size: int) -> None:
    """Draw the subjects of some names, and keep pictures and seconds."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    if program == "cycles":
        import bpy

        bpy.utils.expose_bundled_modules()  # OpenVDB
    for name in names:
        rgba, spent = DRAW[program](scene_of(SUBJECTS[name], size), seconds)
        np.savez(FOLDER / f"{name}-{program}.npz", rgba=np.asarray(rgba, np.float32), seconds=spent)
        print(f"{name}, {program}: {spent:.2f} s", flush=True)


def _shown(rgba, as_bright_as):
    """(H, W, 3) uint8 on a dark ground, sRGB; ``as_bright_as``: a picture whose brightness it is given, or None."""
    if as_bright_as is not None:
        bright, own = (np.quantile(one[one[..., 3] > 0.1, :3].max(axis=-1), BRIGHT) for one in (as_bright_as, rgba))
        rgba = rgba * np.array((*(bright / max(own, 1e-9),) * 3, 1.0))
    linear = np.clip(rgba[..., :3] + (1.0 - rgba[..., 3:]) * 0.008, 0.0, 1.0)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return np.round(255.0 * encoded).astype(np.uint8)


def _kept(name: str, program: str) -> tuple:
    """(rgba, seconds) of a picture that was drawn before."""
    with np.load(FOLDER / f"{name}-{program}.npz") as kept:
        return kept["rgba"], float(kept["seconds"])


def _save(pictures, across: int, path: Path, quality: int) -> None:
    """Save a sheet of (caption, picture as uint8), so many in a row."""
    from PIL import Image

    Image.fromarray(sheet(pictures, across)).save(path, quality=quality)


def join(names, programs, size: int, path: Path, quality: int) -> None:
    """Join the pictures that were kept: a row for each subject, a column for each program, seconds above each.

    Pictures that are a whole number of times larger than ``size`` are scaled down, for smooth edges.
    """
    pictures, table = [], {}
    for name in names:
        table[name] = {}
        for program in programs:
            rgba, seconds = _kept(name, program)
            rgba = rgba.reshape(size, len(rgba) // size, size, -1, 4).mean(axis=(1, 3))
            shown = _shown(rgba, _kept(name, "ours")[0] if program == "cycles" else None)
            pictures.append((f"{name}: {TITLES[program]}, {seconds:.{1 if seconds < 10.0 else 0}f} s", shown))
            table[name][program] = seconds
    _save(pictures, len(programs), path, quality)
    print(json.dumps(table, indent=1))


def join_crops(programs, path: Path, quality: int) -> None:
    """Join CROPS of the pictures that were kept, twice as large: a row for each program."""
    pictures = []
    for program in programs:
        for part, (name, left, top) in CROPS.items():
            shown = _shown(_kept(name, program)[0], None)[top : top + CROP, left : left + CROP]
            pictures.append((f"{part}: {TITLES[program]}", shown.repeat(2, axis=0).repeat(2, axis=1)))
    _save(pictures, len(CROPS), path, quality)


def _filled(scene: Scene) -> Scene:
    """The scene with the camera's lens and shift changed, so that what is seen is in the middle and fills FILLED of the
    picture."""
    seen = render(scene, Quality.preset("draft")).rgba[..., 3] > FAINT
    low, high = np.array([np.flatnonzero(seen.any(axis=axis))[[0, -1]] for axis in (0, 1)]).T / scene.width - 0.5
    closer, (x, y) = FILLED / max(high - low), 0.5 * (low + high)
    camera = scene.camera
    shifts = {"shift_x": closer * (camera.shift_x + x), "shift_y": closer * (camera.shift_y - y)}
    return replace(scene, camera=replace(camera, lens=closer * camera.lens, **shifts))


def join_presets(names, size: int, path: Path, quality: int) -> None:
    """Draw PRESETS of some names at ``fine``, in a brighter world, and join them to a sheet, three in a row."""
    best, pictures = Quality.preset("fine", threads=1), []
    for name in names:
        scene = _filled(replace(scene_of(PRESETS[name], size), world=(SOFT,) * 3))
        pictures.append((name, _shown(render(scene, best).rgba, None)))
    _save(pictures, 3, path, quality)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("program", choices=(*PROGRAMS, "join", "crops", "presets"))
    parser.add_argument("path", type=Path, nargs="?", default=FOLDER / "sheet.png", help="of the sheet")
    parser.add_argument("--subject", nargs="*", choices=list(SUBJECTS), default=list(SUBJECTS))
    parser.add_argument("--scan", nargs="*", choices=list(PRESETS), help="of the sheet of presets, all by default")
    parser.add_argument("--column", nargs="*", choices=PROGRAMS, default=PROGRAMS)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--size", type=int, default=SIZE, help="pixels, wide and high")
    parser.add_argument("--jpeg-quality", type=int, default=80)
    given = parser.parse_args()
    if given.program == "join":
        join(given.subject, given.column, given.size, given.path, given.jpeg_quality)
    elif given.program == "crops":
        join_crops(given.column, given.path, given.jpeg_quality)
    elif given.program == "presets":
        names = [name for name in PRESETS if not given.scan or name in given.scan]
        join_presets(names, given.size, given.path, given.jpeg_quality)
    else:
        draw(given.program, given.subject, given.seconds, given.size)


if __name__ == "__main__":
    main()
