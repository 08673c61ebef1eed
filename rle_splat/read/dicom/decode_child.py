"""The program of a child process that decodes compressed frames: a damaged frame may end it, and nothing else.

    python -P -s decode_child.py

Orders come as lines of standard input: CODEC SLOT LIMIT PATH-IN-HEX OFFSET LENGTH [OFFSET LENGTH ...], where CODEC is
the module that decodes. The frame's fragments are read from the file, and its decoded bytes are written to standard
output at SLOT * LIMIT; standard output and standard error are ordinary files that the parent reads. A line on standard
error says "SLOT BYTES", with -1 bytes for a frame that cannot be decoded. Nothing is printed that comes from a file.
"""

import importlib
import os
import sys
from pathlib import Path

# Memory of a decoder beyond what the process has; measured: four times a decoded frame of 16 bits, half of LIMIT.
SPARE_BYTES, TIMES_FRAME = 64 << 20, 8
ADDRESS_SPACE_USED = Path("/proc/self/statm")  # Linux


def limit_memory(frame: int) -> None:
    """Let an allocation fail that a damaged frame asks for; on systems that have such limits."""
    try:
        import resource
    except ImportError:  # Windows
        return
    try:
        used = int(ADDRESS_SPACE_USED.read_text().split()[0]) * resource.getpagesize()
        most = used + SPARE_BYTES + TIMES_FRAME * frame
        resource.setrlimit(resource.RLIMIT_AS, (most, resource.getrlimit(resource.RLIMIT_AS)[1]))
        resource.setrlimit(resource.RLIMIT_CORE, (0, resource.getrlimit(resource.RLIMIT_CORE)[1]))
    except (OSError, ValueError):  # macOS has no such file
        return


def decode(codec, data: bytes, limit: int):
    """Decoded bytes of one frame, by the module ``codec``; None if it cannot be decoded."""
    try:
        found = codec.decode_pixel_data(data, version=2)
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
    codecs = {}
    with open(pixels, "wb", buffering=0) as output, open(answers, "wb", buffering=0) as report:
        for line in sys.stdin.buffer:
            codec, slot, limit, path, *places = line.decode("ascii").split()
            if codec not in codecs:
                codecs[codec] = importlib.import_module(codec)
                limit_memory(int(limit))
            try:
                data = read_fragments(os.fsdecode(bytes.fromhex(path)), [int(place) for place in places])
            except OSError:
                data = b""
            found = decode(codecs[codec], data, int(limit)) if data else None
            if found is not None:
                output.seek(int(slot) * int(limit))
                view = memoryview(found)
                while view:
                    view = view[output.write(view) :]
            report.write(f"{slot} {-1 if found is None else len(found)}\n".encode("ascii"))


if __name__ == "__main__":
    main()
