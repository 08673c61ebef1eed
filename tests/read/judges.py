"""What other programs say about a file."""

import numpy as np


def affine_by_itk(image) -> np.ndarray:
    """Voxel indices to LPS, as ITK understands an image."""
    affine = np.eye(4)
    affine[:3, :3] = np.array(image.GetDirection()).reshape(3, 3) @ np.diag(image.GetSpacing())
    affine[:3, 3] = image.GetOrigin()
    return affine
