"""Reads mutated files of every format in a process of its own: python -m tests.read.fuzz_child FOLDER SEED COUNT.

Prints one line of JSON: how many were read, how many refused, and what else happened.  A crash, a hang or too much
memory ends the process, which the test notices.
"""

import faulthandler
import json
import resource
import sys
import time
import warnings
from pathlib import Path

import nibabel
import nrrd
import numpy as np
import tifffile

from rle_splat.read.formats import read_volume
from rle_splat.scene import RleSplatError

SHAPE = (12, 11, 10)
EXTRA = 256 << 20  # bytes of address space beyond what the honest files take
SLOW = 5.0  # seconds of processor time for one small file, which takes milliseconds
NUMBERS = (0, 1, 255, 0x7F, 0x80, 0xFF)


def honest(folder: Path) -> dict:
    """Files of every format: name to read -> name to mutate."""
    folder.mkdir(parents=True, exist_ok=True)
    values = (np.random.default_rng(0).integers(0, 3000, SHAPE)).astype(np.int16)
    affine = np.array([(0.9, 0.1, 0, 3), (-0.1, 0.9, 0, 4), (0, 0.2, 2, 5), (0, 0, 0, 1)])
    for name in ("a.nii", "a.nii.gz", "pair.img"):
        kind = nibabel.Nifti1Pair if name == "pair.img" else nibabel.Nifti1Image
        nibabel.save(kind(values, affine), folder / name)
    nibabel.save(nibabel.Nifti2Image(values, affine), folder / "two.nii")
    image = nibabel.Nifti1Image(values.astype(np.uint8), affine)
    table = b'<LabelTable><Label Key="1" Red="1" Green="0" Blue="0"><![CDATA[organ]]></Label></LabelTable>'
    image.header.extensions.append(nibabel.nifti1.Nifti1Extension(0, table))
    nibabel.save(image, folder / "labels.nii.gz")
    nibabel.save(nibabel.freesurfer.MGHImage(values, affine), folder / "a.mgz")
    header = {"space": "RAS", "space directions": affine[:3, :3].T, "space origin": affine[:3, 3]}
    for name, encoding in (("raw.nrrd", "raw"), ("gzip.nrrd", "gzip"), ("bzip2.nrrd", "bzip2"), ("a.nhdr", "raw")):
        nrrd.write(str(folder / name), values, {**header, "encoding": encoding})
    segments = {"Segment0_ID": "a", "Segment0_Name": "b", "Segment0_LabelValue": "1", "Segment0_Layer": "0",
                "Segment0_Color": "1 0 0", "kinds": ["list", *["domain"] * 3]}  # fmt: skip
    nrrd.write(str(folder / "a.seg.nrrd"), np.stack([values, values]), segments)
    text = ("ObjectType = Image\nNDims = 3\nBinaryData = True\nTransformMatrix = 1 0 0 0 1 0 0 0 1\nOffset = 1 2 3\n"
            "ElementSpacing = 1 1 2\nDimSize = 12 11 10\nElementType = MET_SHORT\nElementDataFile = ")  # fmt: skip
    (folder / "a.mha").write_bytes((text + "LOCAL\n").encode() + values.T.tobytes())
    (folder / "a.mhd").write_text(text + "a.bin\n")
    (folder / "a.bin").write_bytes(values.T.tobytes())
    pages = np.ascontiguousarray(values.T)
    tifffile.imwrite(folder / "a.tif", pages, imagej=True, metadata={"axes": "ZYX", "spacing": 2.0, "unit": "um"})
    tifffile.imwrite(folder / "a.ome.tif", pages, ome=True, compression="zlib", metadata={"PhysicalSizeX": 1.0})
    names = [path.name for path in folder.iterdir() if path.suffix not in (".bin", ".raw")]
    return {**{name: name for name in names if name != "pair.img"}, "pair.img": "pair.hdr"}


def mutated(content: bytes, rng) -> bytes:
    """The content with one or a few changes, most of them where headers are."""
    changed = bytearray(content)
    kind = rng.integers(7)
    if kind == 0:
        return bytes(changed[: rng.integers(len(changed))])
    if kind == 1:
        begin = int(rng.integers(len(changed)))
        del changed[begin : begin + int(rng.integers(1, 64))]
        return bytes(changed)
    if kind == 2:
        begin = int(rng.integers(min(len(changed), 600)))
        changed[begin:begin] = rng.integers(0, 256, int(rng.integers(1, 64)), dtype=np.uint8).tobytes()
        return bytes(changed)
    reach = len(changed) if kind == 3 else min(len(changed), 600)
    for _ in range(int(rng.integers(1, 6))):
        at = int(rng.integers(reach))
        if kind == 4 and chr(changed[at]).isdigit():
            changed[at] = int(rng.choice(list(b"0123456789-.ex")))
        elif kind == 5:
            changed[at : at + 4] = bytes([int(rng.choice(NUMBERS))] * 4)
        else:
            changed[at] = int(rng.integers(256))
    return bytes(changed)


def main(folder: str, seed: str, count: str) -> None:
    faulthandler.enable()
    folder, rng = Path(folder), np.random.default_rng(int(seed))
    files = honest(folder)
    warnings.simplefilter("error")  # of what reads; pynrrd's writer calls what Python is about to remove
    for name in files:
        read_volume(folder / name)
    used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    space = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (space + EXTRA, space + EXTRA))
    result = {"read": 0, "refused": 0, "other": [], "slow": []}
    names = sorted(files)
    for number in range(int(count)):
        name = names[number % len(names)]
        original = (folder / files[name]).read_bytes()
        (folder / files[name]).write_bytes(mutated(original, rng))
        begun = time.process_time()
        try:
            read_volume(folder / name)
            result["read"] += 1
        except RleSplatError as problem:
            result["refused"] += 1
            text = str(problem)
            if "\n" in text or not text.endswith(".") or len(text) > 500:
                result["other"].append([number, name, f"no sentence: {text[:200]!r}"])
        except BaseException as problem:
            result["other"].append([number, name, repr(problem)[:200]])
        if time.process_time() - begun > SLOW:
            result["slow"].append([number, name])
        (folder / files[name]).write_bytes(original)
    result["megabytes"] = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - used) / 1024
    print(json.dumps(result))


if __name__ == "__main__":
    main(*sys.argv[1:])
