"""The head as DICOM series gives the picture that it gives in other formats: face forward, the mark at the right."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("pydicom")
pytest.importorskip("SimpleITK")

from rle_splat import Quality, Scene, Volume, fit_preset, read_volume, render, turntable
from tests.read import dicom_phantoms as phantoms
from tests.read.head import head, reordered

SIZE = 144
AIR = -1000


def whole() -> Volume:
    values, affine = head()
    return Volume(np.ascontiguousarray(values.T), affine, space="patient", value_unit="HU", modality="CT")


def picture(volume: Volume) -> np.ndarray:
    """(SIZE, SIZE, 4): a volume's bone by the camera of the whole head, shaded by a headlight."""
    camera, matrix = turntable(whole())
    function, _ = fit_preset("ct-bone", volume)
    scene = Scene(volume, function, camera, SIZE, SIZE, matrix, headlight=True)
    # More single rays than usual: else a pixel at an edge is one for one order of the voxels and not for another.
    return render(scene, Quality.preset("fine", rays=0.2)).rgba


@pytest.fixture(scope="module")
def plain():
    return picture(whole())


@dataclass(frozen=True)
class Slices(phantoms.Geometry):
    """Slices with given values: ``planes`` (n, rows, columns)."""

    planes: np.ndarray

    def values(self, i: int, axis: int) -> np.ndarray:
        return self.planes[i]


def write(folder: Path, stored: np.ndarray, affine: np.ndarray) -> None:
    """One file a slice of voxels (x, y, z) whose affine to LPS has perpendicular x and y."""
    spacing = np.linalg.norm(affine[:3, :3], axis=0)
    row, column = affine[:3, 0] / spacing[0], affine[:3, 1] / spacing[1]
    positions = [affine[:3, 3] + k * affine[:3, 2] for k in range(stored.shape[2])]
    planes = stored.T.astype(np.float64)
    where = Slices("head", tuple(row), tuple(column), (spacing[1], spacing[0]), np.array(positions), planes)
    encoding = phantoms.Encoding(signed=True, intercepts=(-1024.0,))

    def change(dataset, i):
        dataset.Rows, dataset.Columns = stored.shape[1], stored.shape[0]

    phantoms.write_classic(folder, where, encoding=encoding, change=change)


def tilted(values: np.ndarray, affine: np.ndarray):
    """The head on slices whose gantry is tilted: each is moved by one voxel along y."""
    nx, ny, nz = values.shape
    stored = np.full((nx, ny + nz, nz), AIR, values.dtype)
    for k in range(nz):
        stored[:, nz - k : nz - k + ny, k] = values[:, :, k]
    sheared = affine.copy()
    sheared[:3, 3] -= nz * affine[:3, 1]
    sheared[:3, 2] += affine[:3, 1]
    return stored, sheared


@pytest.mark.parametrize("name", ["axial", "feet last", "coronal", "sagittal", "tilted"])
def test_a_series_gives_the_picture(tmp_path: Path, plain, name: str):
    flips, order = {
        "feet last": ((1, 1, -1), (0, 1, 2)), "coronal": ((1, 1, -1), (0, 2, 1)), "sagittal": ((1, 1, -1), (1, 2, 0)),
    }.get(name, ((1, 1, 1), (0, 1, 2)))  # fmt: skip
    stored, affine = reordered(*head(), flips, order)
    if name == "tilted":
        stored, affine = tilted(stored, affine)
    write(tmp_path, stored, affine)
    volume = read_volume(tmp_path)
    assert volume.space == "patient" and volume.value_unit == "HU"
    found = picture(volume)
    # Only the sampling differs with the order of the voxels; between tilted slices other voxels are interpolated.
    largest, mean = (0.2, 0.01) if name == "tilted" else (0.05, 0.002)
    assert np.abs(found - plain).max() < largest
    assert np.sqrt(np.mean((found - plain) ** 2)) < mean < 0.02 < np.sqrt(np.mean((found[:, ::-1] - plain) ** 2))
