"""Proves shaded pictures against the truth fed with colors from a formula: a field whose gradient is known.

The scalar is the squared world distance from a point, so its gradient is exact under central differences and Sobel
weights, whatever the spacing; shells away from the faces are visible.
"""

import numpy as np
import pytest

from rle_splat.accuracy.rays import rigid
from rle_splat.classify.transfer_function import Shade, TransferFunction
from rle_splat.scene import Light
from tests.truths import closed_forms

SHADE = Shade(ambient=0.2, diffuse=0.6, specular=0.3, shininess=12.0)
COLOR = np.array((0.9, 0.4, 0.2))


def shells(shade):
    return TransferFunction(
        opacity=((20.0, 0.0), (40.0, 0.35), (60.0, 0.35), (80.0, 0.0)), color=((0.0, *COLOR),),
        opacity_unit_distance=1.0, shade=shade,
    )  # fmt: skip


def squared_distance(stage, affine, shape=(28, 25, 22)):
    """(volume, (nz, ny, nx, 3) vectors from the center in the volume's space)."""
    z, y, x = np.meshgrid(*(np.arange(n, dtype=np.float64) for n in shape[::-1]), indexing="ij")
    index = np.stack((x, y, z), axis=-1) - 0.5 * (np.array(shape) - 1.0) - (0.6, -0.3, 0.2)
    outward = index @ affine[:3, :3].T
    return stage.volume((outward**2).sum(axis=-1), affine), outward


def unit(v):
    length = np.sqrt((v**2).sum(axis=-1, keepdims=True))
    return v / np.where(length > 0.0, length, 1.0)


def blinn_phong(normal, to_light, to_eye, strength=1.0, shade=SHADE):
    diffuse = np.abs((normal * to_light).sum(axis=-1, keepdims=True)) * strength
    half = np.abs((normal * unit(to_light + to_eye)).sum(axis=-1, keepdims=True))
    return COLOR * (shade.ambient + shade.diffuse * diffuse) + shade.specular * half**shade.shininess * strength


def world_of_voxels(scene):
    nz, ny, nx = scene.volume.voxels.shape
    z, y, x = np.meshgrid(*(np.arange(n, dtype=np.float64) for n in (nz, ny, nx)), indexing="ij")
    matrix = scene.index_to_world
    return np.stack((x, y, z), axis=-1) @ matrix[:3, :3].T + matrix[:3, 3]


AFFINES = {
    "cubic": np.diag((1.0, 1.0, 1.0, 1.0)),
    "anisotropic": np.diag((0.8, 1.0, 1.3, 1.0)),
    "sheared and mirrored": np.array(((-0.9, 0.2, 0, 0), (0, 1.0, 0.3, 0), (0, 0, 1.1, 0), (0, 0, 0, 1.0))),
}


@pytest.mark.parametrize(
    "name, perspective", (("cubic", True), ("anisotropic", False), ("sheared and mirrored", False),
                          ("sheared and mirrored", True)),
)  # fmt: skip
def test_headlight(stage, name, perspective):
    volume, outward = squared_distance(stage, AFFINES[name])
    camera = stage.looking(
        (70.0, -90.0, 55.0), (11.0, 12.0, 11.0), type="PERSP" if perspective else "ORTHO", lens=110.0, ortho_scale=34.0
    )
    scene = stage.before(volume, camera, (64, 64), transfer_function=shells(SHADE), headlight=True)
    matrix = rigid(camera.matrix_world)
    to_light = np.broadcast_to(matrix[:3, 2], outward.shape)
    to_eye = unit(matrix[:3, 3] - world_of_voxels(scene)) if perspective else to_light
    true = stage.truth(scene, colors=blinn_phong(unit(outward), to_light, to_eye))[0]
    unlit = stage.truth(scene)[0]
    assert true[..., 3].max() > 0.8 and np.abs(true - unlit).max() > 0.1
    found = stage.error(scene, true)
    assert found.rmse < 0.3 and found.largest < 3.0


def test_sun_on_a_matt_shell(stage):
    """G10: a sun of pi W/m^2 facing a white Lambert surface gives radiance 1, wherever the camera stands."""
    matt = Shade(ambient=0.1, diffuse=0.8, specular=0.0, shininess=1.0)
    volume, outward = squared_distance(stage, AFFINES["anisotropic"])
    camera = stage.looking((70.0, -90.0, 55.0), (11.0, 12.0, 14.0), lens=110.0)
    sun = stage.looking((0.0, 0.0, 0.0), (0.3, 0.9, -0.5)).matrix_world
    light = Light("SUN", energy=np.pi, matrix_world=sun, casts_shadow=False)
    scene = stage.before(volume, camera, (64, 64), transfer_function=shells(matt), lights=(light,))
    _, facing = closed_forms.radial_lambert(outward, np.zeros(3), np.asarray(sun)[:3, 2])
    true = stage.truth(scene, colors=COLOR * (matt.ambient + matt.diffuse * facing[..., None]))[0]
    found = stage.error(scene, true)
    assert found.rmse < 0.3 and found.largest < 3.0


def test_no_light_means_plain_colors(stage):
    volume, _ = squared_distance(stage, AFFINES["cubic"])
    camera = stage.looking((70.0, -90.0, 55.0), (13.0, 12.0, 11.0), lens=110.0)
    shaded, plain = (
        stage.render(stage.before(volume, camera, (32, 32), transfer_function=shells(shade))).rgba
        for shade in (SHADE, None)
    )
    assert (shaded == plain).all() and plain.max() > 0.3
