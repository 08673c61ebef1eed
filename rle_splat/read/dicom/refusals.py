"""Sentences that refuse bad input. None quotes a value of a file: values may name a patient."""

from pathlib import Path

from ...scene import RleSplatError


class Refused(RleSplatError):
    """Bad DICOM input; its text is one sentence that says what is wrong and what to do.

    ``series``: hash of the series of the file that it is about, where that is known.
    """

    series = ""


class Damaged(Refused):
    """A file that cannot be parsed."""


def damage_error(path) -> Damaged:
    """The file cannot be parsed."""
    return Damaged(f"{Path(path).name} is damaged and cannot be read; copy it again.")


def unreadable(path, problem: OSError) -> Damaged:
    """The system does not let the file be read."""
    reason = problem.strerror or "the disk reports an error"
    return Damaged(f"{Path(path).name} cannot be read: {reason}; check its permissions or copy it again.")


def breaks_off(path, there: int, needed: int) -> Refused:
    """The file holds fewer bytes of voxels than its header states."""
    return Refused(f"{Path(path).name} breaks off: {there} of {needed} bytes of voxels are there; copy it again.")


def frame_damage_error(path, number: int) -> Refused:
    """A compressed frame cannot be decoded; ``number`` counts from 0."""
    return Refused(f"Frame {number + 1} of {Path(path).name} is damaged and cannot be decoded; copy the file again.")


def wrong_frame(path, number: int, found: str, stated: str) -> Refused:
    """A compressed frame's own header differs from the file's; ``number`` counts from 0."""
    return Refused(
        f"Frame {number + 1} of {Path(path).name} holds {found}, but the file states {stated}; export the series again."
    )


def no_images(folder, others: int) -> Refused:
    """A folder without a medical image."""
    files = "only 1 other file" if others == 1 else f"only {others} other files" if others else "and no other files"
    return Refused(f"{Path(folder).name} holds no medical images, {files}; choose the folder of the series.")


def contours_alone(path) -> Refused:
    """An RTSTRUCT where images are wanted."""
    return Refused(
        f"{Path(path).name} holds contours (RTSTRUCT), no image; choose the series of its images, and read the file as "
        "labels."
    )


def single_picture() -> Refused:
    return Refused("This series is a single picture; a volume needs at least two slices.")


def no_positions() -> Refused:
    return Refused(
        "The files of this series do not say where their slices lie; give the spacing, the distances between voxels."
    )
