"""``dev.py test --mutations``: each guard shown to be needed.

A mutant is the package with one stable form put back to the naive one, in a copy with a cache of kernels of its own.
The tests of the case that guards it must go red: a mutant that they let pass has survived, and that is a failure.
Most mutate the reference implementations in numpy, which need no compiling; kernels are mutated where their forms
differ.
"""

from __future__ import annotations

import shutil
import subprocess
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from .environments import BPY, CORE, ensure, ensure_bpy
from .places import KERNELS, ROOT, Failure, clean_environ, say

COPIED = (
    "rle_splat", "bridge", "operators", "panels", "__init__.py", "LICENSE", "blender_manifest.toml", "tests",
    "benchmarks", "devtools", "requirements", "pyproject.toml",
)  # fmt: skip
SECONDS = 240  # for the tests of one mutant; one that hangs is as good as dead
MOST_SECONDS = 900  # for tests without a mutation, all of whose kernels are to be compiled
VALUES, STORED, ENCODING, ACCUMULATION, GEOMETRY, REFERENCES, CACHE_SEARCH = (
    f"tests/stability/test_{group}.py"
    for group in ("values", "values_stored", "encoding", "accumulation", "geometry", "references", "stage_cache_search")
)
LENS, RAYS, METRICS = (f"tests/truths/test_{name}.py" for name in ("lens", "single_rays", "metrics"))
PYRAMID = "tests/comparison/test_laur_hanrahan.py"
NIFTI, METAIMAGE, MGH, NRRD, SUV = (
    f"tests/read/test_{name}.py" for name in ("nifti", "metaimage", "mgh", "nrrd", "suv")
)
RED, GREEN = 1, 0  # pytest's exit codes: some tests failed; all passed.  Anything else is no verdict.


@dataclass(frozen=True)
class Mutant:
    """``changes``: (file under rle_splat, stable form, naive form), each form occurring exactly once.  ``tests``:
    what must go red, as arguments of pytest.  ``compiles``: whether any kernel is made of what is changed; mutants
    without share the kernels that the first of them compiles.  ``by``: "kernels"; "numpy", without numba; or "Blender",
    its module: files are then those under bridge."""

    name: str
    case: str
    changes: tuple[tuple[str, str, str], ...]
    tests: tuple[str, ...]
    compiles: bool = True
    by: str = "kernels"

    def find(self, root: Path, file: str) -> Path:
        """One of its files in a clone."""
        return root / ("bridge" if self.by == "Blender" else "rle_splat") / file


def _left_out(what: str, file: str, key: str, without: str) -> Mutant:
    """A key of the stage cache without one of the things that the stage's result depends on."""
    return Mutant(f"{what} left out of a key", "P5", ((file, key, without),), (CACHE_SEARCH,), compiles=False)


def _plain(what: str, case: str, file: str, form: str, naive: str, *tests: str, by: str = "numpy") -> Mutant:
    """One form of one file that no kernel is made of."""
    return Mutant(what, case, ((file, form, naive),), tests, compiles=False, by=by)


def _read(what: str, file: str, form: str, naive: str, tests: str) -> Mutant:
    """A reader that takes a field of a file for another one."""
    return _plain(what, "reading", f"read/{file}", form, naive, tests)


def _light(what: str, form: str, naive: str) -> Mutant:
    """A formula of light, in its reference implementation."""
    return _plain(what, "light", "shade/reference.py", form, naive, "tests/unit/test_shading.py", "-k", "numpy")


def _ray(what: str, form: str, naive: str, *tests: str, file: str = "reference.py") -> Mutant:
    """A step of single rays."""
    return _plain(what, "single rays", f"raycast/{file}", form, naive, *(tests or (RAYS,)), by="kernels")


def _figure(what: str, file: str, form: str, naive: str) -> Mutant:
    """A rule of figures."""
    return _plain(what, "figures", f"figure/{file}", form, naive, "tests/figure")


def _bridge(what: str, file: str, form: str, naive: str, tests: str) -> Mutant:
    """What the renderer is given of Blender's data; ``tests``: FILE::TEST of tests/blender."""
    return Mutant(what, "bridge", ((file, form, naive),), (f"tests/blender/{tests}",), compiles=False, by="Blender")


MUTANTS = (
    Mutant(
        "a subtraction for expm1, in sheets of the reference implementation", "V5",
        (("splat/reference/sheet_buffer.py", "absorbed = -np.expm1(-tau)", "absorbed = ONE - np.exp(-tau)"),),
        (VALUES, "-k", "V5 and numpy and float32"),
    ),
    Mutant(
        "a subtraction for expm1, in the kernel of a sheet", "V5",
        (("splat/pixel_block.py", "return one - power - power * p,", "return one - (power + power * p),"),),
        (VALUES, "-k", "V5 and numba and float32"),
    ),
    Mutant(
        "1 - (1 - a)^x for the opacity correction", "V4",
        ((
            "splat/reference/sheet_buffer.py",
            "raised = -np.expm1(np.minimum(exponent, LONGEST) * np.log1p(-np.minimum(opacity, ALMOST_ONE)))",
            "raised = ONE - (ONE - np.minimum(opacity, ALMOST_ONE)) ** np.minimum(exponent, LONGEST)",
        ),),
        (VALUES, "-k", "V4 and numpy and float32 and opacity"),
    ),
    Mutant(
        "an optical depth by log for log1p", "V3",
        ((
            "classify/classification.py", "return -np.log1p(-np.minimum(alpha, ALPHA_CAP))",
            "return -np.log(1.0 - np.minimum(alpha, ALPHA_CAP))",
        ),),
        (VALUES, "-k", "V3 and numpy and float32"),
    ),
    Mutant(
        "an opacity of one without its cap", "V2",
        ((
            "classify/classification.py", "return -np.log1p(-np.minimum(alpha, ALPHA_CAP))",
            "return -np.log1p(-np.asarray(alpha))",
        ),),
        (VALUES, "-k", "V2 and numpy and float32 and extinction"),
    ),
    Mutant(
        "opacity accumulated, A += (1 - A) a, for transmittance", "A2",
        ((
            "splat/reference/sheet_buffer.py", "state[..., 3] = np.where(alive, before * transmittance, before)",
            "hidden = ONE - before\n"
            "    state[..., 3] = np.where(alive, ONE - (hidden + (ONE - hidden) * opacity), before)",
        ),),
        (ACCUMULATION, "-k", "A2 and numpy and float32"),
    ),
    Mutant(
        "a color divided by no extinction", "V3",
        (("splat/reference/sheet_buffer.py", "np.exp(-tau)), np.maximum(sigma, TINY)", "np.exp(-tau)), sigma"),),
        (VALUES, "-k", "V3 and numpy and float32"),
    ),
    Mutant(
        "transfer function points left unsorted", "V10",
        ((
            "classify/transfer_function.py", "return tuple(sorted(rows, key=lambda row: row[0]))",
            "return tuple(rows)",
        ),),
        (STORED, "-k", "V10_steps and numpy"),
    ),
    Mutant(
        "a step taken from the left", "V10",
        (("classify/transfer_function.py", 'np.searchsorted(positions, values, side="right")',
          'np.searchsorted(positions, values, side="left")'),),
        (STORED, "-k", "V10_a_step or (V10_steps and numpy)"),
    ),
    Mutant(
        "a look-up by what is not outside, which NaN never is", "V6",
        ((
            "classify/reference.py",
            "((values[:, None] >= shown.intervals[:, 0]) & (values[:, None] < shown.intervals[:, 1]))",
            "(~((values[:, None] < shown.intervals[:, 0]) | (values[:, None] >= shown.intervals[:, 1])))",
        ),),
        (STORED, "-k", "V6_not and numpy"),
    ),
    Mutant(
        "infinities not brought to the end values", "V7",
        ((
            "classify/reference.py",
            "values = np.clip(stored.astype(np.float64) * slope + intercept, -LARGEST, LARGEST)\n    return",
            "values = stored.astype(np.float64) * slope + intercept\n    return",
        ),),
        (STORED, "-k", "V7_V9 and numpy"),
    ),
    Mutant(
        "a normal of any gradient, zero too", "V8",
        (("volume/reference.py", "np.where(keep, world.T / length, 0.0)", "world.T / length"),),
        (STORED, "-k", "V8_a_constant_volume_has and numpy"),
    ),
    Mutant(
        "colors of any brightness", "V14",
        (("classify/transfer_function.py", "if max(rgb) > BRIGHTEST:", "if False:"),),
        (VALUES, "-k", "V14_the_brightest and numpy and float32 and 16"),
    ),
    Mutant(
        "colors and opacities not clamped behind a filter with negative lobes", "V14, A9",
        ((
            "warp/reference.py",
            "rgba[mine, :3] = np.clip(total[:, :3], 0, (most_color * alpha)[:, None])",
            "rgba[mine, :3] = total[:, :3]",
        ),),
        (VALUES, "-k", "V14_colors and numpy and cubic"),
    ),
    Mutant(
        "offsets of 32 bits", "S5",
        (("encode/tables.py", "ends = np.cumsum(counts, dtype=np.int64)", "ends = np.cumsum(counts, dtype=np.int32)"),),
        (ENCODING, "-k", "S5_offsets"),
    ),
    Mutant(
        "run lengths of 16 bits whatever the width", "S4",
        ((
            "encode/tables.py",
            "return np.uint16 if max(shape_xyz) <= np.iinfo(np.uint16).max else np.uint32",
            "return np.uint16",
        ),),
        (ENCODING, "-k", "S4_long and numpy"),
    ),
    Mutant(
        "runs that are not held against the width", "S7",
        (("encode/validate.py", "if (np.add.reduceat(runs, starts, dtype=np.int64) != width).any():", "if False:"),),
        (ENCODING, "-k", "S7_random or S7_damage"),
    ),
    Mutant(
        "the unnormalized Gaussian", "A10",
        (("view/footprints.py", "(values / np.where(total > 0.0, total, 1.0))", "values"),),
        (ACCUMULATION, "-k", "A10_a_constant and numpy and gaussian and simpson and float32"),
    ),
    Mutant(
        "the position of a ray multiplied by an inverse in place of divided", "K1",
        ((
            "view/footprints.py", "return (pixel - shift) / scale",
            "return pixel * (1.0 / scale) - shift * (1.0 / scale)",
        ),),
        (REFERENCES, "-k", "K1 and nearest and float32"),
    ),
    Mutant(
        "the eye of parallel rays without its sign", "C6",
        (("view/eye.py", "if dot(depth[:3], eye[:3]) > 0.0:", "if False:"),),
        (GEOMETRY, "-k", "C6_axes and float32"),
    ),
    Mutant(
        "optical properties cached without the transfer function in their key", "A15",
        ((
            "pipeline/scan_source.py", "key = (visible_key, scene.transfer_function.classification_key, length)",
            "key = (visible_key, length)",
        ),),
        (ACCUMULATION, "-k", "A15 and float32"),
    ),
    _left_out(
        "the gradient opacity of thinned light", "pipeline/scalar_source.py",
        "codes_key = (codes_key, hidden_key, key, tf.gradient_opacity)", "codes_key = (codes_key, hidden_key, key)",
    ),
    _left_out(
        "the light of thinned light", "pipeline/scalar_source.py",
        "codes_key = (codes_key, hidden_key, key, tf.gradient_opacity)",
        "codes_key = (hidden_key, key, tf.gradient_opacity)",
    ),
    _left_out(
        "the length that opacities refer to", "pipeline/scalar_source.py",
        "key = (voxels_key, tf.classification_key, length)", "key = (voxels_key, tf.classification_key)",
    ),
    _left_out(
        "shadows, of post-classified light,", "pipeline/scalar_light.py",
        "key = normals_key, side, tuple(one.key for one in arriving)", "key = normals_key, side, (len(arriving),)",
    ),
    _left_out(
        "the extinction that casts shadows", "pipeline/scan_source.py",
        "runs_steps, *around, unlit.key, boxed=False,", "runs_steps, *around, visible_key, boxed=False,",
    ),
    _left_out(
        "the eye that sees highlights", "pipeline/lighting.py",
        "array_key(falling.rows, falling.material), seen_from)", "array_key(falling.rows, falling.material))",
    ),
    _left_out(
        "the model of records", "pipeline/scan_source.py",
        "return (self.key, quality.model, quality.record, axis)", "return (self.key, quality.record, axis)",
    ),
    _left_out(
        "clips that cast no shadow", "effects/shadows.py",
        "return self.medium_key, self.matrix.tobytes(), triangles, clips, self.boxed",
        "return self.medium_key, self.matrix.tobytes(), triangles, self.boxed",
    ),
    _left_out(
        "the strength of ambient occlusion", "pipeline/shadows.py",
        "(codes, scene.ambient_occlusion, (*key, scene.ambient_occlusion))",
        "(codes, scene.ambient_occlusion, key)",
    ),
    _left_out(
        "the functions of labels and channels", "classify/mixture.py",
        "(part.volume.key, [f and f.key for f in part.functions])", "(part.volume.key, len(part.functions))",
    ),
    Mutant(
        "an orthographic lens whose slant is 2 % off", "depth of field",
        ((
            "effects/lens.py", "slant=tuple(-offset / camera.focus_distance)",
            "slant=tuple(-1.02 * offset / camera.focus_distance)",
        ),),
        (LENS, "-k", "ORTHO"), compiles=False,
    ),
    _read(
        "the qform before the sform", "nifti.py",
        "header.get_sform(coded=True)[0]\n            if affine is None:\n                affine = header.get_qform",
        "header.get_qform(coded=True)[0]\n            if affine is None:\n                affine = header.get_sform",
        NIFTI,
    ),
    _read("a slope of zero", "nifti.py", "if slope == 0.0 or not math", "if not math", NIFTI),
    _read(
        "right and left of NIfTI as they are stored", "nifti.py",
        "return lps_from_ras(scale @ check_affine(path, affine))", "return scale @ check_affine(path, affine)", NIFTI,
    ),
    _read("a TransformMatrix by columns", "metaimage.py", "axes.T * spacing", "axes * spacing", METAIMAGE),
    _read("any byte order", "metaimage.py", '(">" if msb else "<")', '"<"', METAIMAGE),
    _read(
        "every frame the first", "metaimage.py", "parts, (frame - 1) * each, each", "parts, 0, each", METAIMAGE,
    ),
    _read(
        "the center of voxels half a voxel off", "mgh.py", "0.5 * np.array(shape)", "0.5 * (np.array(shape) - 1)", MGH,
    ),
    _read("LAS as LPS", "nrrd.py", '"las": (1, -1, 1)', '"las": (1, 1, 1)', NRRD),
    _read("a dose that does not decay", "dicom/suv.py", "pet.dose * 0.5 ** (elapsed / pet.half_life)", "pet.dose", SUV),
    _read(
        "the time of a series that was made again", "dicom/suv.py",
        "[pet.to_series, *(one.to_acquisition for one in pets if one.to_acquisition is not None)]", "[pet.to_series]",
        SUV,
    ),
    _light(
        "a spot without its soft edge", "falloff *= t * t * (3.0 - 2.0 * t)\n    return towards, falloff",
        "falloff *= t\n    return towards, falloff",
    ),
    _light(
        "ambient light counted twice",
        "np.maximum(everywhere + light_by_normal(n, falling.sky), falling.material[0])",
        "everywhere + light_by_normal(n, falling.sky) + falling.material[0]",
    ),
    _light("an area light that shines backward", "np.maximum(off_axis, 0.0)", "np.abs(off_axis)"),
    _light(
        "a lamp without a size", "np.maximum((way**2).sum(axis=1), light[NEAREST])", "(way**2).sum(axis=1)",
    ),
    _ray("a ray that leaps over every second plane", "np.floor(position) + 1.0", "np.floor(position) + 2.0"),
    _ray(
        "the middle of a slab for the mean over its values", "np.where((spread >= SPAN)[:, None], mean, own)", "own",
    ),
    _ray(
        "the light at the end of a slab", "middle = s[seen] - 0.5 * thick[seen]", "middle = s[seen]",
        "tests/unit/test_ray_light.py",
    ),
    _ray("a brick that counts where all is kept", "np.bitwise_or.reduceat", "np.bitwise_and.reduceat", file="rays.py"),
    _ray("half absorbed where its slab begins", "thick * np.log(state[:, 3] / HALF) / deep", "0.0 * deep"),
    _ray("rays through what is before the camera", "leave = np.where(straight, leave, np.minimum(leave, both[1]))",
         "leave = np.where(straight, leave, both[1])", file="rays.py"),
    _plain("a peak to noise of amplitudes", "errors", "accuracy/metrics.py", "-10.0 * np.log10",
           "-20.0 * np.log10", METRICS),
    _plain("an SSIM of second moments", "errors", "accuracy/metrics.py",
           "_smooth(i * i) - off_i**2, _smooth(r * r) - off_r**2", "_smooth(i * i), _smooth(r * r)", METRICS),
    _plain("the 99th percentile for the 99.9th", "errors", "accuracy/metrics.py", "np.quantile(size, 0.999)",
           "np.quantile(size, 0.99)", METRICS),
    _plain("a depth of half transmittance without what is before it", "truths", "accuracy/integrate.py",
           "_HALF - before[crossing]", "_HALF + 0.0 * before[crossing]", "tests/truths/test_depth_and_stops.py"),
    _figure("letters of the opposite sides", "directions.py", '"left": -right, "right": right',
            '"left": right, "right": -right'),
    _figure("an opacity curve upside down", "color_bar.py", "np.arange(rows)[::-1, None]", "np.arange(rows)[:, None]"),
    _figure("a perspective scale at one unit", "scale.py", "return across / depth_of(scene, depth)", "return across"),
    _figure("a scale that forgets the scene's", "scale.py", "float(scales.mean()) * scene.scene_scale",
            "float(scales.mean())"),
    _plain("a deviation on one side", "comparison", "comparison/pyramid.py",
           "np.maximum(means - least, most - means)", "(most - means)", PYRAMID),
    _plain("means of half of the voxels", "comparison", "comparison/pyramid.py",
           "0.125 * pooled(means, np.add)", "0.25 * pooled(means, np.add)", PYRAMID),
    _plain("sRGB as a power", "colors", "scene/color.py",
           "np.where(colors <= 0.0031308, 12.92 * colors, 1.055 * colors ** (1.0 / 2.4) - 0.055)",
           "colors ** (1.0 / 2.2)", "tests/cli/test_images.py"),
    _plain("rows of a TIFF that are no differences", "files", "cli/rows.py", "differences[:, 1:] -= levels[:, :-1]",
           "pass", "tests/cli/test_tile_option.py", "tests/cli/test_images.py"),
    _plain("a stage whose time goes to the next", "times", "runtime/steps.py",
           "self.stages[before] += 1e3", "self.stages[stage] += 1e3", "tests/unit/test_clock.py", "-k", "not numba"),
    _plain("progress that runs backward", "times", "runtime/steps.py", "if step.fraction < reached:", "if False:",
           "tests/unit/test_clock.py", "-k", "not numba"),
    _plain("a part that is left beside its target", "files", "runtime/whole_files.py", "part.unlink(missing_ok=True)",
           "pass", "tests/cli/test_output.py"),
    _plain("kilobytes for bytes", "memory", "runtime/memory.py",
           '"MemAvailable:"):\n            return 1024 * int',
           '"MemAvailable:"):\n            return int', "tests/unit/test_memory.py", by="kernels"),
    _bridge(
        "an ellipse as large as its box", "scene/lights.py",
        '* (math.pi / 4.0 if data.shape in ("DISK", "ELLIPSE") else 1.0)', "",
        "test_camera.py::test_a_light_that_is_not_normalized_is_as_bright_as_cycles_makes_it",
    ),
    _bridge(
        "the scene's camera for a view's own", "live/surface.py",
        "space.camera if space.use_local_camera else context.scene.camera", "context.scene.camera", "test_live_view.py",
    ),
)  # fmt: skip


def _run(python: Path, folder: Path, tests, environ, seconds: float = SECONDS) -> tuple[int | None, str]:
    """(pytest's exit code, None when the time ran out; the last line it printed)."""
    command = [str(python), "-m", "pytest", "-q", "-x", "--tb=no", "-p", "no:cacheprovider", *tests]
    try:
        done = subprocess.run(
            command, cwd=folder, env=environ, timeout=seconds, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
            text=True, errors="replace",
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return None, f"stopped after {seconds} s"
    return done.returncode, (done.stdout.strip().splitlines() or ["nothing printed"])[-1]


def _mutate(folder: Path, mutant: Mutant) -> dict[Path, str]:
    """Apply a mutant to the copy; what the files held before."""
    before = {}
    for name, stable, naive in mutant.changes:
        path = mutant.find(folder, name)
        text = path.read_text(encoding="utf-8")
        if text.count(stable) != 1:
            raise Failure(f"The mutant '{mutant.name}' no longer fits {name}; bring it up to date.")
        before.setdefault(path, text)
        path.write_text(text.replace(stable, naive), encoding="utf-8")
    return before


def mutations(only: str = "") -> int:
    """Run every mutant whose name holds ``only``; prints a line for each, and returns 1 if any survives."""
    python = ensure(CORE)
    chosen = [mutant for mutant in MUTANTS if only in mutant.name]
    survivors, started = [], time.monotonic()
    with tempfile.TemporaryDirectory(prefix="rle-splat-mutants-") as place:
        folder, cache = Path(place) / "copy", Path(place) / "cache"
        folder.mkdir()
        for name in COPIED:
            source = ROOT / name
            ignored = shutil.ignore_patterns("__pycache__")
            shutil.copytree(source, folder / name, ignore=ignored) if source.is_dir() else shutil.copy(source, folder)
        whole = clean_environ(RLE_SPLAT_CACHE=str(KERNELS))
        broken = clean_environ(RLE_SPLAT_CACHE=str(cache), PYTHONDONTWRITEBYTECODE="1")
        shared = broken | {"RLE_SPLAT_CACHE": str(Path(place) / "shared")}
        environs = {"kernels": shared, "Blender": shared, "numpy": shared | {"NUMBA_DISABLE_JIT": "1"}}
        pythons = {"kernels": python, "numpy": python}
        if any(mutant.by == "Blender" for mutant in chosen):
            pythons["Blender"] = ensure_bpy(list(BPY)[-1])
        without: dict[tuple, tuple] = {}  # tests -> what they came to without a mutation
        for mutant in chosen:
            begun = time.monotonic()
            # Without the mutation they must be green, or red would prove nothing.
            if mutant.tests not in without:
                # Here kernels are compiled for all mutants that share them, so that no time runs out on account of it.
                own = folder, mutant.tests, environs[mutant.by], MOST_SECONDS
                how = (ROOT, mutant.tests, whole) if mutant.compiles else own
                without[mutant.tests] = _run(pythons[mutant.by], *how)
            code, outcome = without[mutant.tests]
            if code == GREEN:
                before = _mutate(folder, mutant)
                environ = broken if mutant.compiles else environs[mutant.by]
                code, outcome = _run(pythons[mutant.by], folder, mutant.tests, environ)
                for path, text in before.items():
                    path.write_text(text, encoding="utf-8")
                verdict = "killed" if code in (RED, None) else "SURVIVED"
            else:
                verdict = "NO VERDICT, red already"
            if verdict != "killed":
                survivors.append(mutant.name)
            say(f"{verdict:<9} {mutant.case:<8} {mutant.name}  ({time.monotonic() - begun:.0f} s; {outcome})")
            shutil.rmtree(cache, ignore_errors=True)
    say(f"\n{len(chosen) - len(survivors)} of {len(chosen)} mutants killed in {time.monotonic() - started:.0f} s")
    return 1 if survivors or not chosen else 0
