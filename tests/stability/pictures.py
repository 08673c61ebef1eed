"""Pictures of a few scenes, made in a process of its own and written to a file, to be held against another's.

python -m tests.stability.pictures FILE [--threads N ...] [--scenes NAME ...]
writes FILE (.npz) with the picture and the depth of each scene and number of threads.  Needs numpy, and numba or not.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np

from benchmarks.phantoms import FIELDS
from rle_splat.classify.transfer_function import TransferFunction
from rle_splat.pipeline.render import render
from rle_splat.scene import CLASSIFICATIONS, Camera, Quality, Scene
from rle_splat.view.turntable import turntable
from rle_splat.volume.volume import Volume

FUNCTION = TransferFunction(
    name="pictures", opacity=((20.0, 0.0), (30.0, 0.0), (250.0, 0.7)), opacity_unit_distance=1.0, shade=None,
    color=((0.0, 0.9, 0.3, 0.1), (255.0, 0.1, 0.4, 1.0)),
)  # fmt: skip
SIZE = (61, 47)


def scene(name: str) -> tuple[Scene, Quality]:
    """One of SCENES: what it shows, and how well."""
    voxels = np.rint(255.0 * FIELDS["smooth"](20)[:, :17, :14]).astype(np.uint8)
    volume = Volume(voxels, np.diag((1.0, 1.1, 0.9, 1.0)))
    camera, matrix = turntable(volume, 37.0, 24.0, 1.0, name != "parallel", 50.0)
    quality = Quality(classification="pre")
    if name == "inside":
        place = np.eye(4)
        place[:3, :3] = np.linalg.qr(np.array(((1.0, 0.4, -0.3), (0.2, 1.0, 0.5), (0.1, -0.6, 1.0))))[0]
        place[:3, 3] = 6.3, 7.1, 8.4
        camera, matrix = Camera(place, lens=6.0, clip_start=1e-3), np.eye(4)
    if name == "opacities":
        quality = Quality.paper()
    if name == "post":
        quality = Quality(classification="post")
    return Scene(volume, FUNCTION, camera, *SIZE, volume_matrix=matrix, headlight=False), quality


SCENES = ("parallel", "inside", "opacities", *(("post",) if "post" in CLASSIFICATIONS else ()))


def pictures(names=SCENES, threads=(0,)) -> dict[str, np.ndarray]:
    """(H, W, 5) float32 of each scene and number of threads: color, alpha and depth."""
    made = {}
    for name in names:
        shown, quality = scene(name)
        for count in threads:
            picture = render(shown, replace(quality, threads=count))
            made[f"{name} {count}"] = np.concatenate((picture.rgba, picture.depth[..., None]), axis=-1)
    return made


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("file")
    parser.add_argument("--threads", type=int, nargs="*", default=[0])
    parser.add_argument("--scenes", nargs="*", default=SCENES)
    wanted = parser.parse_args()
    np.savez(wanted.file, **pictures(wanted.scenes, wanted.threads))
