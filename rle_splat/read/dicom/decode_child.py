"""The program of a child process that decodes compressed frames: a damaged frame may end it, and nothing else.

    python -P -s decode_child.py

Orders come as lines of standard input: CODEC SLOT LIMIT COUNT PATH-IN-HEX OFFSET LENGTH [OFFSET LENGTH ...]. The
frame's fragments are read from the file, and its decoded bytes are written to standard output at SLOT * LIMIT; standard
output and standard error are ordinary files that the parent reads. A line on standard error says "SLOT BYTES", with
-1 bytes for a frame that cannot be decoded. Nothing is printed that comes from a file.
"""

import os
import sys

ADDRESS_SPACE = 1 << 32  # bytes; more is never needed for one frame


def limit_memory() -> None:
    """Let an allocation that a damaged frame asks for fail; on systems that have such limits."""
    try:
        import resource
    except ImportError:  # Windows
        return
    for name, most in (("RLIMIT_AS", ADDRESS_SPACE), ("RLIMIT_CORE", 0)):
        if hasattr(resource, name):
            try:
                resource.setrlimit(getattr(resource, name), (most, resource.getrlimit(getattr(resource, name))[1]))
            except (OSError, ValueError):  # macOS refuses some limits
                continue


def decode(codec: str, data: bytes, limit: int):
    """Decoded bytes of one frame; None if it cannot be decoded."""
    if codec == "openjpeg":
        from openjpeg import decode_pixel_data
    else:
        from libjpeg import decode_pixel_data
    try:
        found = decode_pixel_data(data, version=2)
    except (ArithmeticError, LookupError, MemoryError, RuntimeError, TypeError, ValueError):
        return None
    return found if len(found) <= limit else None


def read_fragments(path: str, places: list) -> bytes:
    with open(path, "rb") as file:
        parts = []
        for offset, length in zip(places[::2], places[1::2]):
            file.seek(offset)
            parts.append(file.read(length))
    return b"".join(parts)


def main() -> None:
    pixels, answers = os.dup(1), os.dup(2)
    silence = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silence, 1)  # a decoder may print
    os.dup2(silence, 2)
    limit_memory()
    with open(pixels, "wb", buffering=0) as output, open(answers, "wb", buffering=0) as report:
        for line in sys.stdin.buffer:
            codec, slot, limit, path, *places = line.decode("ascii").split()
            try:
                data = read_fragments(os.fsdecode(bytes.fromhex(path)), [int(place) for place in places])
            except OSError:
                data = b""
            found = decode(codec, data, int(limit)) if data else None
            if found is not None:
                output.seek(int(slot) * int(limit))
                view = memoryview(found)
                while view:
                    view = view[output.write(view) :]
            report.write(f"{slot} {-1 if found is None else len(found)}\n".encode("ascii"))


if __name__ == "__main__":
    main()
