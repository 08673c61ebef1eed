"""Writer of a lit medium as OpenVDB grids, which Cycles, EEVEE and other renderers draw.

The grid ``density`` is extinction, and ``emission`` extinction times color: what a medium emits per length so that it
looks as it does here.  Color is their quotient.  The product is stored, since products may be interpolated.
"""

from pathlib import Path

import numpy as np

from ..runtime.whole_files import whole_file
from ..scene import RleSplatError
from .vdb import OPENVDB_PROBLEMS, load_openvdb

DENSITY, EMISSION = "density", "emission"


class MediumFile:
    """The grids of a medium while they are filled, one plane after the other.

    Parameters
    ----------
    factor : float
        What extinctions are multiplied by.

    Raises
    ------
    RleSplatError
        Without the OpenVDB module.
    """

    def __init__(self, factor: float = 1.0):
        self._openvdb, self._factor = load_openvdb(), np.float32(factor)
        self._density, self._emission = self._openvdb.FloatGrid(), self._openvdb.Vec3SGrid()
        for grid, name in ((self._density, DENSITY), (self._emission, EMISSION)):
            grid.name, grid.gridClass = name, "fog volume"

    def add(self, plane: int, records: np.ndarray) -> None:
        """Add a plane of voxels.

        Parameters
        ----------
        plane : int
            Index along z.
        records : (ny, nx, 4) ndarray of float32
            Extinction times scene-linear RGB, and extinction.
        """
        scaled = self._factor * records.transpose(1, 0, 2)[:, :, None]
        # OpenVDB misreads an array that is not C-ordered, without an error.
        self._density.copyFromArray(np.ascontiguousarray(scaled[..., 3]), ijk=(0, 0, plane), tolerance=0)
        self._emission.copyFromArray(np.ascontiguousarray(scaled[..., :3]), ijk=(0, 0, plane), tolerance=(0, 0, 0))

    def save(self, path, matrix: np.ndarray) -> None:
        """Write the file, or leave none.

        Parameters
        ----------
        path : str or Path
            Its folder is made if there is none.
        matrix : (4, 4) array_like
            Voxel index (x, y, z, 1) to the space of the medium.

        Raises
        ------
        RleSplatError
            If it cannot be written, or OpenVDB takes no grid as small.
        """
        try:
            for grid in (self._density, self._emission):
                grid.transform = self._openvdb.createLinearTransform(np.transpose(matrix).tolist())  # of row vectors
        except ArithmeticError:
            raise RleSplatError("The volume is too small in the scene for OpenVDB; raise the scene scale.") from None
        path = Path(path)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            with whole_file(path) as unfinished:
                self._openvdb.write(str(unfinished), grids=[self._density, self._emission])
        except OPENVDB_PROBLEMS as problem:
            reason = getattr(problem, "strerror", None) or str(problem).strip().rstrip(".")
            raise RleSplatError(f"Cannot write {path}: {reason}; choose another location.") from None
