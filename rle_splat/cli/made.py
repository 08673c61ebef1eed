"""Which pictures of a series are made already: whole, and of the same scene by the same options.

Beside each numbered picture stands a small hidden file, ``.out_0012.png.made``.  It holds a hash of everything that the
picture depends on, and the size and a hash of the picture's file.  So a picture of another scene, an incomplete one and
one that somebody edited are distinguished from one that is made.  The voxels are hashed, not the times of their files.
"""

import glob
import hashlib
import json
import time
from contextlib import suppress
from functools import cache
from pathlib import Path

from ..runtime.array_hash import hash_plain
from ..runtime.whole_files import PART

AT_ONCE = 1 << 20  # bytes of a file
ABANDONED = 3600.0  # seconds after which a temporary file that nobody writes to is of a command that was killed
# Fields that a picture's bits do not depend on.
WITHOUT_EFFECT = {"threads", "reasons_off", "name", "remarks", "source"}


@cache
def source_hash() -> str:
    """Hash of this package's own files: programs with the same one make the same pictures of the same scenes."""
    root, digest = Path(__file__).parents[1], hashlib.blake2b(digest_size=16)
    for path in sorted(path for suffix in ("py", "json") for path in root.rglob(f"*.{suffix}")):
        digest.update(f"{path.relative_to(root).as_posix()}\0".encode() + path.read_bytes())
    return digest.hexdigest()


def hash_scene(*values) -> str:
    """Hash of a Scene, a Quality and plain values: of dataclasses every field counts that a picture depends on.

    It is the same for the same values and the same ``source_hash``, in every process and on every machine.
    """
    return hash_plain(source_hash(), *values, without=WITHOUT_EFFECT)


def mark_of(path) -> Path:
    """The hidden file beside a picture."""
    path = Path(path)
    return path.with_name(f".{path.name}.made")


def write_mark(mark, scene_hash: str, picture) -> None:
    """Write the hidden file ``mark`` of a picture's file ``picture``, which is complete."""
    size, content = _content(picture)
    text = json.dumps({"scene": scene_hash, "bytes": size, "blake2b": content})
    Path(mark).write_text(text + "\n", encoding="utf-8")


def is_made(paths, scene_hash: str) -> bool:
    """Whether all pictures are complete and of the scene with this hash."""
    return find_scene_hash(paths) == scene_hash


def find_scene_hash(paths) -> str | None:
    """The hash of the scene that all pictures show; None where one is missing, incomplete or of another scene."""
    found = {_scene_of(path) for path in paths}
    return found.pop() if len(found) == 1 else None


def _scene_of(path) -> str | None:
    try:
        held = json.loads(mark_of(path).read_text(encoding="utf-8"))
        # The size first: a picture that was cut short need not be read.
        is_whole = held["bytes"] == Path(path).stat().st_size and held["blake2b"] == _content(path)[1]
        return str(held["scene"]) if is_whole else None
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _content(path) -> tuple[int, str]:
    """Size and hash of a file."""
    digest, size = hashlib.blake2b(digest_size=16), 0
    with open(path, "rb") as file:
        while data := file.read(AT_ONCE):
            digest.update(data)
            size += len(data)
    return size, digest.hexdigest()


def delete_abandoned(paths) -> None:
    """Delete temporary files that commands which were killed have left beside pictures."""
    before = time.time() - ABANDONED
    for path in (file for picture in map(Path, paths) for file in (picture, mark_of(picture))):
        for part in path.parent.glob(f".*{PART}{glob.escape(path.name)}"):
            with suppress(OSError):  # another process deletes it too
                if part.stat().st_mtime < before:
                    part.unlink()


def report_kept(own) -> dict:
    """The report of a frame that is there already."""
    return {"command": "render", "outputs": outputs_of(own), "kept": True}


def outputs_of(args) -> list:
    """The picture files of one command, or of one of its frames."""
    return [*args.output, *([] if args.shadow_pass is None else [args.shadow_pass])]


def describe_kept(reports: list[dict]) -> list[str]:
    """How many pictures were kept, as lines for people."""
    count = sum(len(report["outputs"]) for report in reports if report.get("kept"))
    if not count:
        return []
    pictures = "picture that was" if count == 1 else "pictures that were"
    return [f"Kept {count} {pictures} there already; --again makes all anew."]
