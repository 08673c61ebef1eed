"""dev.py sidebyside: the same scan, camera and lamp by RLE Splat, Cycles' own volumes and VTK, with processor seconds.

As a script (in the benchmarks' environment) it draws with VTK what side_by_side_scene.py left in a folder, and puts the
three pictures together: ``python -m devtools.side_by_side FOLDER``.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from .blender_job import run_job
from .environments import any_bpy, ensure_bench
from .places import OUT, ROOT, clean_environ, pixels, run, say

FOLDER = OUT / "side-by-side"
PRESET = "ct-bone"
SAMPLES = 2  # of VTK, for each voxel along a ray
BACKGROUND = 0.03  # scene-linear
THREADS = 1


def side_by_side(size: str, samples: int) -> int:
    """Make side-by-side.png and seconds.json in out/side-by-side."""
    bench = ensure_bench()
    run_job(any_bpy(), "side_by_side_scene.py", FOLDER, size=list(pixels(size)), samples=samples)
    words = [bench, "-m", "devtools.side_by_side", FOLDER]
    run(words, "VTK could not draw the scan.", cwd=ROOT, env=clean_environ())
    say(f"{FOLDER / 'side-by-side.png'}\n{(FOLDER / 'seconds.json').read_text()}")
    return 0


def draw_with_vtk(folder: Path, facts: dict):
    """The picture by VTK's ray caster on the processor, shaded by its preset's material, and its processor seconds.

    Returns
    -------
    rgba : ndarray, shape (height, width, 4), float32
        Scene-linear, premultiplied, row 0 on top.
    seconds : float
        Of all threads, with the gradients, which VTK computes for its first picture.
    """
    import time

    import numpy as np
    import vtk
    from vtk.util.numpy_support import numpy_to_vtk, vtk_to_numpy

    import rle_splat
    from benchmarks.vtk_caster import value_functions

    options = facts["options"]
    volume = rle_splat.read_volume(folder / facts["file"], **options)
    function, _ = rle_splat.fit_preset(PRESET, volume)
    image = vtk.vtkImageData()
    image.SetDimensions(*options["shape"])
    voxels = np.ascontiguousarray(volume.voxels).reshape(-1)
    image.GetPointData().SetScalars(numpy_to_vtk(voxels))
    placed = np.array(facts["voxel_to_world"])
    placed[:3] *= 1000.0  # lengths in millimeters, as opacities are
    steps = np.linalg.norm(placed[:3, :3], axis=0)
    image.SetSpacing(*steps)
    mapper = vtk.vtkFixedPointVolumeRayCastMapper()
    mapper.SetInputData(image)
    mapper.SetNumberOfThreads(THREADS)
    mapper.AutoAdjustSampleDistancesOff()
    mapper.LockSampleDistanceToInputSpacingOff()
    mapper.SetImageSampleDistance(1.0)
    mapper.SetSampleDistance(float(steps.min()) / SAMPLES)
    opacity, color = value_functions(volume, function)
    material = vtk.vtkVolumeProperty()
    material.SetScalarOpacity(opacity)
    material.SetColor(color)
    material.SetScalarOpacityUnitDistance(float(function.opacity_unit_distance or 1.0))
    material.SetInterpolationTypeToLinear()
    material.ShadeOn()
    material.SetAmbient(function.shade.ambient)
    material.SetDiffuse(function.shade.diffuse)
    material.SetSpecular(function.shade.specular)
    material.SetSpecularPower(function.shade.shininess)
    actor = vtk.vtkVolume()
    actor.SetMapper(mapper)
    actor.SetProperty(material)
    matrix = vtk.vtkMatrix4x4()
    matrix.DeepCopy((placed @ np.diag((*(1.0 / steps), 1.0))).ravel())
    actor.SetUserMatrix(matrix)
    renderer = vtk.vtkRenderer()
    renderer.SetBackgroundAlpha(0.0)
    renderer.AddVolume(actor)
    renderer.AutomaticLightCreationOff()
    lamp = vtk.vtkLight()
    lamp.SetLightTypeToSceneLight()
    lamp.SetPosition(*facts["sun"])
    lamp.SetFocalPoint(0.0, 0.0, 0.0)
    renderer.AddLight(lamp)
    window = vtk.vtkRenderWindow()
    window.SetOffScreenRendering(1)
    window.SetMultiSamples(0)
    window.SetAlphaBitPlanes(1)
    window.AddRenderer(renderer)
    width, height = facts["size"]
    window.SetSize(width, height)
    matrix_world = np.array(facts["camera"])
    eye, camera = 1000.0 * matrix_world[:3, 3], renderer.GetActiveCamera()
    camera.SetPosition(*eye)
    camera.SetFocalPoint(*(eye - matrix_world[:3, 2]))
    camera.SetViewUp(*matrix_world[:3, 1])
    camera.SetViewAngle(facts["view_angle"])
    renderer.ResetCameraClippingRange()
    began = time.process_time()
    window.Render()
    seconds = time.process_time() - began
    found = vtk.vtkFloatArray()
    window.GetRGBAPixelData(0, 0, width - 1, height - 1, 1, found)
    rgba = vtk_to_numpy(found).reshape(height, width, 4)[::-1].copy()
    window.Finalize()
    return rgba, round(seconds, 2)


def put_together(folder: Path) -> None:
    """Draw with VTK, and write the three pictures in a row, each with its name and its processor seconds."""
    import numpy as np
    from PIL import Image, ImageDraw, ImageFont

    facts = json.loads((folder / "scene.json").read_text())
    by_vtk, facts["seconds"]["vtk"] = draw_with_vtk(folder, facts)
    seconds, shots = facts["seconds"], []
    for name, rgba in (
        ("RLE Splat", np.load(folder / "ours.npy")), ("Cycles", np.load(folder / "cycles.npy")), ("VTK", by_vtk),
    ):  # fmt: skip
        linear = np.clip(rgba[..., :3] + (1.0 - rgba[..., 3:]) * BACKGROUND, 0.0, 1.0)
        coded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
        shot = Image.fromarray(np.rint(255.0 * coded).astype(np.uint8))
        spent = seconds[{"RLE Splat": "ours"}.get(name, name.lower())]
        words = f"{name}, {spent:.{1 if spent < 20 else 0}f} s"
        size = shot.width // 22
        ImageDraw.Draw(shot).text((size // 2, size // 2), words, "white", ImageFont.load_default(size))
        shots.append(np.asarray(shot))
    Image.fromarray(np.hstack(shots)).save(folder / "side-by-side.png")
    Image.open(folder / "side-by-side.png").save(folder / "side-by-side.jpg", quality=88)
    (folder / "seconds.json").write_text(json.dumps(seconds, indent=1) + "\n")


if __name__ == "__main__":
    put_together(Path(sys.argv[1]))
