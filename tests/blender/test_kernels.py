"""The kernels of the installed extension, which one Python compiled for all, make the plain implementations' picture.

Those of this Python agree with those of others (tests/stability/test_same_picture.py), so its kernels do, too.
"""

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

# Every picture that is prepared, in small, in a process that has compiled nothing; of each stored type where it has
# kernels of its own.
PREPARE = """
from rle_splat.pipeline import prepare
from rle_splat.runtime.jit import while_compiling
from rle_splat.runtime.steps import drain
prepare.SIDE, compiled, count = 32, [], 0
with while_compiling(lambda: compiled.append(1)):
    for picture in prepare.PICTURES:
        for stored in prepare.STORED_TYPES if picture.more else prepare.STORED_TYPES[:1]:
            drain(prepare.picture_steps(picture, stored))
            count += 1
print(count > 40, len(compiled))
"""


@pytest.fixture
def pictures(core):
    """A shaded picture of a ball at the usual quality, by kernels and without."""
    scene, z = core("scene"), np.arange(12) - 5.5
    radius = np.sqrt(z[:, None, None] ** 2 + z[:, None] ** 2 + z**2)
    voxels = np.clip(255.0 - 45.0 * radius, 0.0, 255.0).astype(np.uint8)
    volume = core("volume.volume").Volume(voxels, np.diag((1.0, 1.1, 0.9, 1.0)))
    function = core("classify.transfer_function").TransferFunction(
        opacity=((20.0, 0.0), (250.0, 0.7)), color=((0.0, 0.9, 0.3, 0.1), (255.0, 0.1, 0.4, 1.0))
    )
    camera, matrix = core("view.turntable").turntable(volume, 37.0, 24.0, 1.0, True, 50.0)
    render = core("pipeline.render").render
    shown = scene.Scene(volume, function, camera, 61, 47, volume_matrix=matrix)
    fast = render(shown, scene.Quality()).rgba
    with core("runtime.jit").use_reference():
        return fast, render(shown, scene.Quality()).rgba


def test_A13_kernels_and_plain_implementations_make_one_picture(pictures, core):
    fast, plain = pictures
    assert core("runtime.jit").compiled() and plain[..., 3].max() > 0.3
    # A rounding may turn a value to the next entry of the lookup table.
    np.testing.assert_allclose(fast, plain, rtol=0.0, atol=2e-3)


def test_the_zip_brings_the_kernels_that_are_prepared(core, extension_zip, tmp_path):
    """For this Blender's own numpy, too, which may round constants in another way."""
    jit = core("runtime.jit")
    with zipfile.ZipFile(extension_zip) as archive:
        brought = [name for name in archive.namelist() if name.startswith("rle_splat/kernels/")]
    if not brought:
        pytest.skip("this zip brings no kernels")
    assert jit.shipped_level() in brought[0] and not jit.shipped_problem()
    installed = str(Path(jit.__file__).parents[2])
    environ = os.environ | {"RLE_SPLAT_CACHE": str(tmp_path), "PYTHONPATH": os.pathsep.join((installed, *sys.path))}
    done = subprocess.run(
        [sys.executable, "-c", PREPARE], env=environ, cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.stdout.split() == ["True", "0"], done.stderr
