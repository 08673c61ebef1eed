"""The DICOM folder of the tutorial: read as a scan of a patient, the right way around and calibrated."""

import numpy as np

from devtools.phantom import BEAD_MM, STEEL
from devtools.practice_ct import write_series
from rle_splat import read_volume


def test_the_practice_ct_is_a_calibrated_scan_of_a_patient(tmp_path):
    count = write_series(tmp_path / "ct", spacing_mm=5.0)
    volume = read_volume(tmp_path / "ct")
    assert (volume.modality, volume.value_unit, volume.space) == ("CT", "HU", "patient")
    assert volume.shape_xyz == (39, 48, count) and not volume.remarks
    np.testing.assert_allclose(volume.spacing, 5.0)
    assert volume.value_range[0] == -1000.0
    # The steel bead is outside the left temple: DICOM's axes are left and back, the phantom's right and front.
    z, y, x = np.unravel_index(np.argmax(volume.voxels), volume.voxels.shape)
    place = (volume.affine @ (x, y, z, 1.0))[:3]
    assert np.abs(place - np.array((-BEAD_MM[0], -BEAD_MM[1], BEAD_MM[2]))).max() < 5.0
    assert volume.value_range[1] > 0.5 * STEEL
