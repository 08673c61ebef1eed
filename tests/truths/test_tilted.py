"""A scan with a tilted gantry is rendered where it lies, without resampling: compared with a fine upright grid."""

import numpy as np
import pytest

from rle_splat import Quality, Scene, TransferFunction, Volume, render, turntable

SIZE = 96


def field(points) -> np.ndarray:
    """A smooth body of soft edges at points (..., 3) in millimeters: two overlapping balls, off the middle."""
    first = np.linalg.norm((points - (0.0, 5.0, 0.0)) / (30.0, 24.0, 26.0), axis=-1)
    second = np.linalg.norm((points - (14.0, -18.0, 12.0)) / (14.0, 12.0, 14.0), axis=-1)
    return 1000.0 / (1.0 + np.exp((first - 1.0) * 9.0)) + 700.0 / (1.0 + np.exp((second - 1.0) * 6.0))


def sampled(axes, counts) -> Volume:
    """The field on a grid of ``counts`` voxels with the columns of ``axes``, about the origin, in patient space."""
    affine = np.eye(4)
    affine[:3, :3] = axes
    affine[:3, 3] = -affine[:3, :3] @ (0.5 * (np.array(counts) - 1.0))
    z, y, x = np.indices(counts[::-1])
    points = np.stack((x, y, z), axis=-1) @ affine[:3, :3].T + affine[:3, 3]
    return Volume(field(points).astype(np.float32), affine, space="patient")


FINE = (np.eye(3), (121, 121, 121))
SLOPE = np.radians(20.0)
TILTED = {
    "tilted": (np.array([(1.5, 0, 0), (0, 1.5, 2.5 * np.sin(SLOPE)), (0, 0, 2.5 * np.cos(SLOPE))]), (81, 101, 49)),
    "mirrored": (np.array([(-1.5, 0, 0), (0, 1.5, -0.9), (0, 0, 2.4)]), (81, 101, 51)),
}  # fmt: skip


def picture(volume, camera) -> np.ndarray:
    """The shaded picture of a volume with a camera in the patient's space."""
    function = TransferFunction(
        opacity=((200.0, 0.0), (600.0, 0.25), (1200.0, 0.5)), color=((200.0, 0.7, 0.3, 0.2), (1200.0, 0.9, 0.9, 0.8)),
        opacity_unit_distance=2.0,
    )  # fmt: skip
    scene = Scene(volume, function, camera, SIZE, SIZE, headlight=True)
    return render(scene, Quality.preset("fine")).rgba


@pytest.mark.parametrize("azimuth, elevation", [(0.0, 0.0), (35.0, 20.0)])
@pytest.mark.parametrize("name", TILTED)
def test_a_tilted_scan_gives_the_picture_of_a_fine_upright_one(name, azimuth, elevation):
    """Gradients included; the same voxels taken as upright give another picture, so the bound means something."""
    upright = sampled(*FINE)
    camera, _ = turntable(upright, azimuth, elevation)
    truth = picture(upright, camera)
    axes, counts = TILTED[name]
    tilted = sampled(axes, counts)
    error = np.sqrt(np.mean((picture(tilted, camera) - truth) ** 2))
    affine = np.diag((*tilted.spacing, 1.0))
    affine[:3, 3] = -0.5 * tilted.spacing * (np.array(counts) - 1.0)
    wrong = np.sqrt(np.mean((picture(Volume(tilted.voxels, affine, space="patient"), camera) - truth) ** 2))
    assert truth[..., 3].max() > 0.8
    assert error < 0.003 < 0.02 < wrong
