"""NIfTI to raw voxels and their facts as JSON on stdout (runs in an environment with nibabel)."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import nibabel
import numpy as np


def main(arguments) -> int:
    source, target = Path(arguments[0]), Path(arguments[1])
    image = nibabel.load(source)
    voxels = np.asanyarray(image.dataobj)  # (x, y, z), stored values
    if voxels.dtype.kind not in "ui" or image.header.get_slope_inter() not in ((None, None), (1.0, 0.0)):
        voxels = voxels.astype(np.float32)
    voxels = np.ascontiguousarray(voxels.transpose(2, 1, 0))  # x fastest
    partial = target.with_suffix(".part")
    partial.write_bytes(voxels.astype(voxels.dtype.newbyteorder("<")).tobytes())
    partial.replace(target)
    facts = {
        "shape": list(voxels.shape[::-1]),
        "dtype": voxels.dtype.name,
        "byte_order": "little",
        "spacing": [float(value) for value in image.header.get_zooms()[:3]],
        "affine": image.affine.tolist(),
        "axes": "".join(nibabel.aff2axcodes(image.affine)),
    }
    print(json.dumps(facts))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
