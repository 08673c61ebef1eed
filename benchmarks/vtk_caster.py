"""VTK's CPU ray caster with the same camera, transfer function and size.

It uses vtkFixedPointVolumeRayCastMapper with one or more samples per voxel, linear interpolation, opacity per voxel
spacing, no automatic coarsening, and the given number of threads.  It interpolates values and then classifies them, so
its truth is T2.  The package vtk is installed only in the benchmarks' environment.
"""

from __future__ import annotations

import numpy as np

from rle_splat.scene import Scene

from .frames import seconds
from .spent import Spent

try:
    import vtk
    from vtk.util.numpy_support import numpy_to_vtk, vtk_to_numpy

    VTK_PROBLEM = ""
except ImportError as problem:
    vtk = None
    VTK_PROBLEM = str(problem)

TABLE_POINTS = 4096  # samples of the transfer function for VTK


class VtkCaster:
    """One volume and transfer function, those of ``scene``, in VTK, for drawing any number of views.

    ``samples`` are those per smallest voxel spacing along a ray.  The only lamp, a white parallel one, shines to
    ``along``; left out, it shines along the camera's axis.
    """

    def __init__(self, scene: Scene, shaded: bool, threads: int, samples: int = 1, along=None):
        volume, tf = scene.volume, scene.transfer_function
        spacing = volume.spacing
        image = vtk.vtkImageData()
        image.SetDimensions(*volume.shape_xyz)
        image.SetSpacing(*spacing)
        self._voxels = np.ascontiguousarray(volume.voxels).reshape(-1)  # VTK refers to this memory: keep it alive
        image.GetPointData().SetScalars(numpy_to_vtk(self._voxels))
        self._mapper = vtk.vtkFixedPointVolumeRayCastMapper()
        self._mapper.SetInputData(image)
        self._mapper.SetNumberOfThreads(threads)
        self._mapper.AutoAdjustSampleDistancesOff()
        self._mapper.LockSampleDistanceToInputSpacingOff()
        self._mapper.SetImageSampleDistance(1.0)
        self._mapper.SetSampleDistance(float(spacing.min()) / samples)
        self._mapper.SetInteractiveSampleDistance(float(spacing.min()) / samples)
        properties = vtk.vtkVolumeProperty()
        opacity, color = _functions(volume, tf)
        properties.SetScalarOpacity(opacity)
        properties.SetColor(color)
        properties.SetScalarOpacityUnitDistance(float(tf.opacity_unit_distance or spacing.min()))
        properties.SetInterpolationTypeToLinear()
        properties.SetShade(bool(shaded and tf.shade is not None))
        if shaded and tf.shade is not None:
            properties.SetAmbient(tf.shade.ambient)
            properties.SetDiffuse(tf.shade.diffuse)
            properties.SetSpecular(tf.shade.specular)
            properties.SetSpecularPower(tf.shade.shininess)
        actor = vtk.vtkVolume()
        actor.SetMapper(self._mapper)
        actor.SetProperty(properties)
        self._renderer = vtk.vtkRenderer()
        self._renderer.SetBackground(0.0, 0.0, 0.0)
        self._renderer.SetBackgroundAlpha(0.0)
        self._renderer.AddVolume(actor)
        placed = scene.index_to_world @ np.diag((*1.0 / spacing, 1.0))
        actor.SetUserMatrix(_matrix(placed))
        if along is not None:
            self._renderer.AutomaticLightCreationOff()
            lamp = vtk.vtkLight()
            lamp.SetLightTypeToSceneLight()
            lamp.PositionalOff()
            lamp.SetPosition(*(-np.asarray(along, float)))
            lamp.SetFocalPoint(0.0, 0.0, 0.0)
            lamp.SetAmbientColor(1.0, 1.0, 1.0)  # VTK multiplies the ambient coefficient by it, and begins with black
            self._renderer.AddLight(lamp)
        self._window = vtk.vtkRenderWindow()
        self._window.SetOffScreenRendering(1)
        self._window.SetMultiSamples(0)
        self._window.SetAlphaBitPlanes(1)
        self._window.AddRenderer(self._renderer)

    def draw(self, scene: Scene, repeats: int = 1) -> tuple[np.ndarray, Spent]:
        """Draw a view: premultiplied float32 (height, width, 4), row 0 on top, and the time of the fastest picture.

        Its frame is the whole, with the transfer to the window.
        """
        self._window.SetSize(scene.width, scene.height)
        self._aim(scene)
        self._window.Render()  # computes gradients and resizes; not timed
        spent = []
        for _ in range(repeats):
            began = seconds()
            self._renderer.GetActiveCamera().Modified()
            self._window.Render()
            spent.append(1e3 * (seconds() - began))
        pixels = vtk.vtkFloatArray()
        self._window.GetRGBAPixelData(0, 0, scene.width - 1, scene.height - 1, 1, pixels)
        rgba = vtk_to_numpy(pixels).reshape(scene.height, scene.width, 4)
        return np.ascontiguousarray(rgba[::-1]), Spent(min(spent), min(spent))

    def close(self) -> None:
        """Free the window's memory."""
        self._window.Finalize()

    def _aim(self, scene: Scene) -> None:
        """Set the scene's camera."""
        camera, placed = self._renderer.GetActiveCamera(), scene.camera
        matrix = placed.matrix_world
        eye, backwards, up = matrix[:3, 3], matrix[:3, 2], matrix[:3, 1]
        camera.SetPosition(*eye)
        camera.SetFocalPoint(*(eye - backwards))
        camera.SetViewUp(*up)
        camera.SetClippingRange(placed.clip_start, placed.clip_end)
        if placed.type == "ORTHO":
            camera.ParallelProjectionOn()
            camera.SetParallelScale(0.5 * placed.ortho_scale)
        else:
            camera.ParallelProjectionOff()
            camera.SetViewAngle(np.degrees(2.0 * np.arctan(0.5 * placed.sensor_height / placed.lens)))


def _matrix(values):
    """VTK's form of a (4, 4) matrix."""
    made = vtk.vtkMatrix4x4()
    made.DeepCopy(np.asarray(values, float).reshape(-1).tolist())
    return made


def _functions(volume, tf):
    """VTK's opacity and color functions over stored values, sampled from a transfer function in physical values."""
    opacity, color = vtk.vtkPiecewiseFunction(), vtk.vtkColorTransferFunction()
    kind = volume.voxels.dtype
    if kind.kind in "iu" and kind.itemsize == 1:
        stored = np.arange(np.iinfo(kind).min, np.iinfo(kind).max + 1.0)
    else:
        stored = np.linspace(float(volume.voxels.min()), float(volume.voxels.max()), TABLE_POINTS)
    values = volume.physical(stored)
    for at, alpha, (red, green, blue) in zip(stored, tf.alpha_at(values), tf.color_at(values)):
        opacity.AddPoint(at, alpha)
        color.AddRGBPoint(at, red, green, blue)
    return opacity, color
