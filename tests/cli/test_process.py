"""The command line as its own process: module entry, signals, pipes, speed of start-up, real scans."""

from __future__ import annotations

import errno
import gzip
import io
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from rle_splat.classify.default import default_transfer_function
from rle_splat.classify.presets import fit_preset
from rle_splat.cli import streams
from rle_splat.read.formats import read_volume

ROOT = Path(__file__).resolve().parents[2]
COMMAND = (sys.executable, "-m", "rle_splat")


def start(*words, **environ):
    def hear_ctrl_c():  # whoever runs the tests in the background may have it ignored, which is inherited
        signal.signal(signal.SIGINT, signal.SIG_DFL)

    return subprocess.Popen(
        [*COMMAND, *map(str, words)], cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        env={**os.environ, **environ}, preexec_fn=None if os.name == "nt" else hear_ctrl_c,
    )  # fmt: skip


def run(*words):
    process = start(*words)
    out, err = process.communicate()
    return process.returncode, out.decode(), err.decode()  # not as text: that would turn returns into new lines


def test_render_and_help(tmp_path, raw, raw_options):
    code, out, err = run("render", raw, *raw_options, "--size", "16", "-o", tmp_path / "p.npy")
    assert (code, err) == (0, "") and "Wrote" in out
    assert np.load(tmp_path / "p.npy").shape == (16, 16, 4)
    code, out, err = run("--help")
    assert code == 0 and "usage: rle-splat" in out and err == ""


def test_progress_only_when_asked(tmp_path, raw, raw_options):
    code, _, err = run("render", raw, *raw_options, "--size", "16", "-o", tmp_path / "p.npy", "--progress")
    assert code == 0 and "\r" in err and "%" in err and "Splatting" in err and err.count("\n") == 0


def test_information_does_not_load_numba(raw, raw_options):
    """What only looks at a file starts without the compiler; a script's ``import rle_splat`` too."""
    program = (
        "import sys; from rle_splat.cli.main import main; code = main(sys.argv[1:]); "
        "sys.exit(code or 5 * ('numba' in sys.modules or 'PIL' in sys.modules))"
    )
    words = [sys.executable, "-c", program, "info", str(raw), *raw_options]
    assert subprocess.run(words, cwd=ROOT, capture_output=True).returncode == 0


def test_only_the_command_that_is_asked_for_is_loaded():
    """And none that is not: its options are not looked at."""
    program = (
        "import sys; from rle_splat.cli.main import COMMANDS, main; code = main(sys.argv[1:]); "
        "print(*(name for name in COMMANDS if f'rle_splat.cli.{name}' in sys.modules)); sys.exit(code)"
    )
    for words, loaded in ((["--help"], ""), (["render", "--help"], "render"), (["info", "--help"], "info")):
        done = subprocess.run([sys.executable, "-c", program, *words], cwd=ROOT, capture_output=True, text=True)
        assert done.returncode == 0 and done.stdout.splitlines()[-1] == loaded


def test_a_process_leaves_without_looking_through_its_memory(raw, raw_options):
    program = (
        "import gc, sys; from rle_splat.cli.main import run_process; before = gc.get_freeze_count(); "
        "print(run_process(), before, gc.get_freeze_count() > 0)"
    )
    for words, code in ((["info", str(raw), *raw_options], 0), (["info"], 2)):
        done = subprocess.run([sys.executable, "-c", program, *words], cwd=ROOT, capture_output=True, text=True)
        assert done.stdout.splitlines()[-1] == f"{code} 0 True"


def test_a_reader_that_goes_away_is_no_error(raw, raw_options):
    process = start("info", raw, *raw_options)
    process.stdout.close()
    err = process.stderr.read()
    assert process.wait() == 0 and err == b""


def test_a_reader_of_the_progress_that_goes_away_does_not_end_the_work(tmp_path, raw, raw_options):
    process = start("render", raw, *raw_options, "--size", "16", "-o", tmp_path / "p.npy", "--progress")
    process.stderr.close()
    assert process.wait() == 0 and "Wrote" in process.stdout.read().decode()
    process.stdout.close()
    assert np.load(tmp_path / "p.npy").shape == (16, 16, 4)


def test_windows_reports_a_reader_that_went_away_as_an_invalid_argument():
    class Ended(io.RawIOBase):
        def writable(self):
            return True

        def write(self, _data):
            raise OSError(errno.EINVAL, "Invalid argument")

    stream = streams._Lasting(Ended(), 4)
    assert stream.write(b"dropped") == 7 and stream.write(b"too") == 3
    stream.close()


@pytest.mark.skipif(os.name == "nt", reason="Windows has no interval timers")
def test_a_line_that_is_stopped_is_written_once():
    """The timer's signals come anywhere within ``print``."""
    program = """if True:
        import signal
        from rle_splat.cli.streams import settle_streams
        def stop(*_):
            if printing:
                raise KeyboardInterrupt
        printing = False
        settle_streams()
        signal.signal(signal.SIGALRM, stop)
        signal.setitimer(signal.ITIMER_REAL, 5e-5, 5e-5)
        for number in range(20000):
            try:
                printing = True
                print(f"<{number}>", flush=True)
            except KeyboardInterrupt:
                pass
            finally:
                printing = False
        signal.setitimer(signal.ITIMER_REAL, 0)
    """
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True)
    lines = re.findall(r"<\d+>", done.stdout)  # an end of line may be missing
    assert done.stderr == "" and len(lines) > 1000 and len(lines) == len(set(lines))


@pytest.mark.skipif(os.name == "nt", reason="its shell cannot close streams")
@pytest.mark.parametrize("closed", ["2>&-", "<&- >&- 2>&-"])
def test_closed_streams_do_not_keep_a_picture_from_being_written(tmp_path, raw, raw_options, closed):
    words = [*COMMAND, "render", raw, *raw_options, "--size", "16", "--progress", "-o", tmp_path / "p.npy"]
    done = subprocess.run(["sh", "-c", f'exec "$@" {closed}', "sh", *map(str, words)], cwd=ROOT, capture_output=True)
    assert done.returncode == 0 and (b"Wrote" in done.stdout) == (closed == "2>&-")
    assert np.load(tmp_path / "p.npy").shape == (16, 16, 4)


def test_names_outside_the_encoding_of_the_output_are_escaped(tmp_path, raw, raw_options):
    path = tmp_path / "\u65e5.npy"
    words = ["render", raw, *raw_options, "--size", "16", "-o", path]
    done = subprocess.run(
        [*COMMAND, *map(str, words)], cwd=ROOT, env={**os.environ, "PYTHONIOENCODING": "ascii", "PYTHONUTF8": "1"},
        capture_output=True,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, b"") and b"\\u65e5.npy" in done.stdout
    assert path.is_file()


@pytest.mark.skipif(os.name == "nt", reason="Windows has no SIGINT to send to one process")
def test_ctrl_c_leaves_nothing_half_made(tmp_path):
    """Stopped in the middle of a long picture: exit code 130, one sentence, the old file still there."""
    volume, output = tmp_path / "v.raw", tmp_path / "p.npy"
    np.random.default_rng(1).integers(0, 256, 96**3, dtype=np.uint8).tofile(volume)
    output.write_bytes(b"old")
    before = sorted(tmp_path.iterdir())
    words = ("--shape", 96, 96, 96, "--dtype", "uint8", "--size", 1500, "--preset", "faint")
    process = start("render", volume, *words, "-o", output, "--progress", NUMBA_DISABLE_JIT="1")
    seen = b""
    while b"Splatting" not in seen and process.poll() is None:
        seen += process.stderr.read(1)
    time.sleep(0.5)
    process.send_signal(signal.SIGINT)
    rest = process.stderr.read().decode()
    assert process.wait() == 130
    assert rest.endswith("Stopped; nothing was written.\n") and "Traceback" not in rest
    assert sorted(tmp_path.iterdir()) == before and output.read_bytes() == b"old"


@pytest.mark.skipif(os.name == "nt", reason="Windows has no SIGINT to send to one process")
def test_ctrl_c_within_code_that_is_made_of_text(tmp_path):
    """As while a dataclass is made, in an import: Python then ends a process that handled it by the signal."""
    (tmp_path / "stopped.py").write_text(
        "import os, signal, sys\n"
        "from rle_splat.cli import main\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "main._run = lambda argv: exec('os.kill(os.getpid(), signal.SIGINT)\\nwhile True: pass')\n"
        "sys.exit(main.run_process())\n"
    )
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join((str(tmp_path), str(ROOT)))}
    words = [sys.executable, "-m", "stopped"]
    done = subprocess.run(words, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (130, "Stopped; nothing was written.\n")


def projected_alpha(voxels, function, spacing, azimuth, size):
    """(size, size) alpha of voxels (nz, ny, nx) seen along a horizontal direction, by adding up the optical depths of
    all voxels whose center falls on a pixel: no ray, no run and no sheet has a part in it."""
    alpha = function.alpha_at(np.arange(int(voxels.max()) + 1.0))[voxels]
    at = np.nonzero(alpha)
    depth = -np.log1p(-np.minimum(alpha[at], 1.0 - 2.0**-24))
    lengths = np.multiply(voxels.shape[::-1], spacing)
    z, y, x = ((at[2 - i] + 0.5) * spacing[i] - 0.5 * lengths[i] for i in (2, 1, 0))
    pixel = 1.25 * lengths.max() / size
    column = (x * np.cos(azimuth) + y * np.sin(azimuth)) / pixel + 0.5 * size
    row = 0.5 * size - z / pixel
    depths = np.zeros((size, size))
    np.add.at(depths, (row.astype(int), column.astype(int)), depth * np.prod(spacing) / (min(spacing) * pixel**2))
    return -np.expm1(-depths)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name, shape, kind, spacing, preset",
    [
        ("bonsai_256x256x256_uint8.raw.gz", (256, 256, 256), "u1", (1, 1, 1), "ct-botanical"),
        ("cthead_256x256x113_uint16be.raw.gz", (113, 256, 256), ">u2", (1, 1, 2), None),
        ("lobster_120x120x34_uint16le.raw.gz", (34, 120, 120), "<u2", (1, 1, 1), None),
    ],
)
def test_real_scans(data, tmp_path, name, shape, kind, spacing, preset):
    """Pictures of real scans against a projection of their voxels: mirrored or turned ones are far from it."""
    output = tmp_path / "p.npy"
    options = ("--spacing", *spacing, *(("--preset", preset) if preset else ()), "--size", 96, "--azimuth", 30)
    code, _, err = run("render", data / name, *options, "-o", output)
    assert (code, err) == (0, ""), err
    alpha = np.load(output)[..., 3]
    voxels = np.frombuffer(gzip.decompress((data / name).read_bytes()), kind).reshape(shape)
    volume = read_volume(data / name, spacing=spacing)
    function = (fit_preset(preset, volume) if preset else default_transfer_function(volume))[0]
    expected = projected_alpha(voxels, function, spacing, np.radians(30), 96)
    seen, wanted = alpha > 0.1, expected > 0.1
    # Measured: shares of 0.586, 0.279 and 0.086 of the pixels, off by 0.052, 0.015 and 0.001; of what either of the two
    # shows 0.911, 0.944 and 0.968 in both; and a mean error of alpha of 0.046, 0.009 and 0.005.  (A pixel of the
    # projection has all voxels that fall on it, one of the picture what its ray meets: thin leaves differ.)
    assert abs(seen.mean() - wanted.mean()) < 0.06
    assert (seen & wanted).sum() > 0.9 * (seen | wanted).sum()
    assert np.abs(alpha - expected).mean() < 0.05


def test_the_facade_means_the_verbs_whoever_came_first():
    program = (
        "import rle_splat.pipeline.render, rle_splat.encode.store, rle_splat\n"
        "from rle_splat import encode, render, read_volume\n"
        "assert callable(rle_splat.render) and callable(rle_splat.encode) and rle_splat.render is render\n"
        "assert all(hasattr(rle_splat, name) for name in rle_splat.__all__)"
    )
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
