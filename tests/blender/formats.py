"""Small volumes in files of every format that is read: by the libraries in the extension, by the extension itself, or
by hand.

The libraries are imported where they are used: they are there when the extension is.
"""

import json
from importlib import import_module
from pathlib import Path

import numpy as np

SHAPE = 9, 7, 5  # x, y, z
METAIMAGE = "ObjectType = Image\nNDims = 3\nDimSize = 9 7 5\nElementType = MET_SHORT\nElementDataFile = "


def values() -> np.ndarray:
    """(9, 7, 5) int16 along x, y, z."""
    return (np.arange(5 * 7 * 9) * 37 % 30000).astype(np.int16).reshape(SHAPE)


def write_families(folder: Path) -> tuple[str, ...]:
    """``values()`` in one file of each family of medical files, and two of some; their names."""
    import nibabel
    import nrrd
    import tifffile

    voxels = values()
    nibabel.save(nibabel.Nifti1Image(voxels, np.eye(4)), folder / "one.nii")
    nibabel.save(nibabel.Nifti2Image(voxels, np.eye(4)), folder / "two.nii.gz")
    nibabel.save(nibabel.AnalyzeImage(voxels, np.eye(4)), folder / "pair.img")
    nibabel.save(nibabel.freesurfer.MGHImage(voxels, np.eye(4)), folder / "a.mgh")
    nibabel.save(nibabel.freesurfer.MGHImage(voxels, np.eye(4)), folder / "b.mgz")
    nrrd.write(str(folder / "a.nrrd"), voxels, {"encoding": "gzip"})
    nrrd.write(str(folder / "b.nhdr"), voxels, {"encoding": "raw"})
    (folder / "a.mha").write_bytes(f"{METAIMAGE}LOCAL\n".encode() + voxels.T.tobytes())
    (folder / "b.mhd").write_text(f"{METAIMAGE}b.voxels\n")
    (folder / "b.voxels").write_bytes(voxels.T.tobytes())
    tifffile.imwrite(folder / "a.ome.tif", np.ascontiguousarray(voxels.T), ome=True, compression="zlib")
    return (
        "one.nii", "two.nii.gz", "pair.img", "pair.hdr", "a.mgh", "b.mgz", "a.nrrd", "b.nhdr", "a.mha", "b.mhd",
        "a.ome.tif",
    )  # fmt: skip


def write_series(folder: Path, number: int, count: int) -> None:
    """DICOM files of a series, each a disc that grows."""
    from pydicom.dataset import Dataset, FileMetaDataset
    from pydicom.uid import ExplicitVRLittleEndian, generate_uid

    folder.mkdir(parents=True)
    series, (y, x) = generate_uid(), np.mgrid[-1:1:64j, -1:1:64j]
    for i in range(count):
        data = Dataset()
        data.file_meta = FileMetaDataset()
        data.file_meta.TransferSyntaxUID = ExplicitVRLittleEndian
        data.file_meta.MediaStorageSOPClassUID = data.SOPClassUID = "1.2.840.10008.5.1.4.1.1.2"
        data.file_meta.MediaStorageSOPInstanceUID = data.SOPInstanceUID = generate_uid()
        data.SeriesInstanceUID, data.SeriesNumber, data.InstanceNumber = series, number, i + 1
        data.Modality, data.BodyPartExamined, data.SeriesDescription = "CT", "HEAD", f"disc {number}"
        data.Rows = data.Columns = 64
        data.ImagePositionPatient, data.ImageOrientationPatient = [0, 0, 2.0 * i], [1, 0, 0, 0, 1, 0]
        data.PixelSpacing, data.RescaleSlope, data.RescaleIntercept = [1.5, 1.5], 1, -1024
        data.BitsAllocated, data.BitsStored, data.HighBit, data.PixelRepresentation = 16, 16, 15, 0
        data.SamplesPerPixel, data.PhotometricInterpretation = 1, "MONOCHROME2"
        disc = x**2 + y**2 < (0.3 + 0.4 * i / count) * number / 2
        data.PixelData = np.where(disc, 2000, 24).astype("<u2").tobytes()
        data.save_as(folder / f"{i:04d}", enforce_file_format=True)


def write_zarr(path: Path, levels) -> Path:
    """A folder as OME-Zarr 0.5 has it, of chunks that are not packed."""
    codec = {"name": "bytes", "configuration": {"endian": "little"}}
    datasets = []
    for number, level in enumerate(levels):
        folder = path / str(number)
        (folder / "c" / "0" / "0").mkdir(parents=True)
        (folder / "c" / "0" / "0" / "0").write_bytes(level.astype("<u2").tobytes())
        (folder / "zarr.json").write_text(json.dumps({
            "zarr_format": 3, "node_type": "array", "shape": level.shape, "data_type": "uint16", "fill_value": 0,
            "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": level.shape}},
            "chunk_key_encoding": {"name": "default", "configuration": {"separator": "/"}}, "codecs": [codec],
            "attributes": {},
        }))  # fmt: skip
        scale = [float(2**number)] * 3
        datasets.append({"path": str(number), "coordinateTransformations": [{"type": "scale", "scale": scale}]})
    axes = [{"name": name, "type": "space", "unit": "micrometer"} for name in "zyx"]
    image = {"version": "0.5", "multiscales": [{"axes": axes, "datasets": datasets}]}
    group = {"zarr_format": 3, "node_type": "group", "attributes": {"ome": image}}
    (path / "zarr.json").write_text(json.dumps(group))
    return path


def write_every_format(folder: Path, module: str) -> dict[str, tuple[str, ...]]:
    """A file of every row of the table of formats, as a user chooses it: names, or those of files chosen together ->
    options of its own in the import dialog. ``module`` is the add-on's."""
    import nibabel
    import tifffile

    formats = import_module(f"{module}.rle_splat.read.formats")
    found = dict.fromkeys(write_families(folder), ("use_first_frame",))
    found["a.ome.tif"] = ("use_first_frame", "use_file_spacing")
    (folder / "head_9x7x5_int16.raw").write_bytes(values().T.tobytes())
    volume = formats.read_volume(folder / "head_9x7x5_int16.raw", shape=SHAPE, dtype="int16", spacing=(1.0, 1.0, 1.0))
    for name in ("packed_9x7x5_int16.raw.gz", "smoke_0001.vdb", "smoke_0002.vdb"):
        formats.write_volume(volume, folder / name)
    found["head_9x7x5_int16.raw"] = found["packed_9x7x5_int16.raw.gz"] = ("shape", "dtype", "use_file_spacing")
    found["smoke_0001.vdb"] = ("grid", "use_sequence")
    for number, page in enumerate(values().T, 1):
        tifffile.imwrite(folder / f"page_{number:02d}.tif", page)
    found["page_01.tif"] = ("use_first_frame", "use_file_spacing")
    write_series(folder / "series", 1, 5)
    (folder / "series" / "0000").rename(folder / "series" / "0000.dcm")
    found["series/0000.dcm"] = ("use_only_series", "use_first_frame", "use_file_spacing")
    write_zarr(folder / "a.zarr", (values().T, values().T[::2, ::2, ::2]))
    found["a.zarr/zarr.json"] = ("use_fitting_level", "use_first_frame")
    (folder / "masks").mkdir()
    for number, organ in enumerate(("liver", "spleen")):
        mask = (np.indices(SHAPE)[0] // 5 == number).astype(np.uint8)
        nibabel.save(nibabel.Nifti1Image(mask, np.eye(4)), folder / "masks" / f"{organ}.nii.gz")
    return found


def write_dose(path: Path) -> Path:
    """An RTDOSE of 60 Gy about a place in the practice CT's brain, on a grid of its own."""
    from pydicom import Dataset
    from pydicom.dataset import FileMetaDataset
    from pydicom.uid import ExplicitVRLittleEndian, generate_uid

    step, count = 4.0, 32
    z, y, x = (np.mgrid[:count, :count, :count] - (count - 1) / 2) * step
    gray = 60.0 * np.exp(-((x / 22.0) ** 2 + (y / 30.0) ** 2 + (z / 22.0) ** 2))
    one = Dataset()
    one.file_meta = FileMetaDataset()
    one.file_meta.TransferSyntaxUID = ExplicitVRLittleEndian
    one.SOPClassUID, one.SOPInstanceUID = "1.2.840.10008.5.1.4.1.1.481.2", generate_uid()
    one.file_meta.MediaStorageSOPClassUID = one.SOPClassUID
    one.file_meta.MediaStorageSOPInstanceUID = one.SOPInstanceUID
    one.Modality, one.DoseUnits, one.DoseType, one.DoseSummationType = "RTDOSE", "GY", "PHYSICAL", "PLAN"
    one.StudyInstanceUID, one.SeriesInstanceUID = generate_uid(), generate_uid()
    one.FrameOfReferenceUID = f"{import_module('devtools.practice_ct').ROOT_UID}.4"
    one.ImagePositionPatient = [step * (0.5 - count / 2) + shift for shift in (15.0, 0.0, 25.0)]
    one.ImageOrientationPatient, one.PixelSpacing = [1, 0, 0, 0, 1, 0], [step, step]
    one.GridFrameOffsetVector, one.DoseGridScaling = (step * np.arange(count)).tolist(), 0.001
    one.Rows = one.Columns = one.NumberOfFrames = count
    one.SamplesPerPixel, one.PhotometricInterpretation, one.PixelRepresentation = 1, "MONOCHROME2", 0
    one.BitsAllocated, one.BitsStored, one.HighBit = 16, 16, 15
    one.PixelData = np.rint(gray / 0.001).astype("<u2").tobytes()
    one.save_as(path, enforce_file_format=True)
    return path
