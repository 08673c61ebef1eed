"""Encode a scene whose tables do not fit into memory: chunk by chunk, into a folder of tables (``encode.members``).

A chunk of planes is classified, lit and encoded by the stages that encode a whole volume. Its voxels keep their place
in the volume, so that positions, normals and light are the same to the bit.
"""

import hashlib
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from os import PathLike

import numpy as np

from ..classify.classification import unit_length
from ..classify.placing import RecordPositions
from ..classify.relevant import Reach, count_kept, gather_kept, relevant_steps
from ..classify.visible import Visibility, VisibleVoxels, mark_steps
from ..effects.analyze import analyze_effects
from ..effects.mixing import is_mixed
from ..effects.ray_values import find_shown_values
from ..encode import members
from ..encode.encode import record_steps, reorder_steps, run_tables
from ..encode.folder import FolderWriter, is_folder_form
from ..encode.records import decoding_of, words_of
from ..encode.scalars import OWN_TYPES, center_of, in_scanlines, scalars_of
from ..encode.tables import RunTables, counts_of
from ..runtime.cache_folder import RELEASE
from ..runtime.memory import available_bytes
from ..runtime.steps import Clock, Progress, announce, drain, rescale
from ..scene import Quality, QualityName, RleSplatError, Scene, TooLargeError, as_quality
from ..shade.shading import DENSITY
from ..shade.surface_normals import BEYOND, gaussian, surface_steps
from ..shade.surface_points import faces_of, place_steps
from ..volume.axes import AXES
from ..volume.blocks import block_steps
from ..volume.reduced import reduce_steps
from ..volume.volume import key_steps
from .encode_scene import describe_lighting
from .lighting import scene_lighting
from .memory_estimate import PlannedTables, VoxelCount, estimate_tables, refuse_too_much
from .scalar_light import light_of, smoothness_of
from .scalar_source import find_value_ends
from .scan_source import LitVolume, make_scan_source
from .shadows import shadow_count

COARSE_VOXELS = 1 << 24  # a volume of more is stored in larger voxels, too: with so many a viewport turns smoothly
DENSER = 1.5  # times as dense as a chunk the next one may be
LEAST_DENSITY = 1.0 / 32.0  # so that a chunk of hidden planes does not become the whole volume
SHARE = 0.25  # of the free memory that a chunk may take: the rest is for the fixed costs and the picture
RECORDS, SCALARS = "records", "scalars"  # tables of voxels, with SURFACE


@dataclass(frozen=True, eq=False)
class _ChunkTables:
    """The tables of a chunk by name, what the header says of it, and its visible voxels."""

    tables: dict
    facts: dict
    visible: int


def encode_folder(
    scene: Scene,
    path: str | PathLike,
    quality: Quality | QualityName | None = None,
    axes: Sequence[int] = tuple(AXES),
    source: str = "",
) -> dict:
    """Classify, shade and encode the volume of a scene into a folder of tables, chunk by chunk.

    Parameters
    ----------
    scene : Scene
        Its volume may be mapped from a file.
    path : str or Path
        The folder, which ``read_encoded`` opens. It appears under this name when it is complete.
    quality : Quality or str, optional
        Its classification ("pre" or "post"), model, record and threads count. The name of a preset means "post", as for
        ``render``; left out, "pre".
    axes : sequence of int
        Principal axes that pictures can be made along, 0, 1, 2 for x, y, z.
    source : str
        Name of the file that the volume was read from.

    Returns
    -------
    dict
        A report.

    Raises
    ------
    RleSplatError
        If the scene needs all voxels at once (shadows, labels, channels), one plane does not fit into memory, or the
        folder cannot be written. Nothing is left behind then.
    """
    quality = Quality(classification="pre") if quality is None else as_quality(quality)
    return drain(encode_folder_steps(scene, quality, path, axes, source))


def encode_folder_steps(scene: Scene, quality: Quality, path, axes=tuple(AXES), source: str = ""):
    """Generator of Progress: as ``encode_folder``."""
    with FolderWriter(path) as writer:
        return (yield from write_folder_steps(scene, quality, writer, axes, source))


def write_folder_steps(scene: Scene, quality: Quality, writer: FolderWriter, axes=tuple(AXES), source: str = ""):
    """As ``encode_folder_steps``, into the folder of a FolderWriter."""
    _check(scene, quality)
    scene, clock, volume = analyze_effects(scene, quality)[1], Clock(), scene.volume
    looking = "Looking through the voxels"
    with clock.stage("classify"):
        yield from announce(key_steps(volume), 0.0, 0.02, looking)
    kind = _ClassifiedChunks if quality.classification == "pre" else _ScalarChunks
    chunks = kind(scene, quality, axes)
    writer.begin(_job(scene, quality, axes))
    resumed = writer.planes
    has_coarse = yield from rescale(
        _coarse_steps(scene, quality, writer.folder / members.COARSE, axes, source), 0.02, 0.02
    )
    with clock.stage("classify"):
        yield from announce(chunks.prepare_steps(), 0.02, 0.04, looking)
    nx, ny, nz = volume.shape_xyz
    density = 1.0  # visible voxels among all; of the first chunk nothing is known
    while (first := writer.planes) < nz:
        last = min(first + chunks.planes_at_once(density), nz)
        yield Progress(0.04 + 0.94 * first / nz, f"Encoding planes {first + 1} to {last} of {nz}")
        try:
            with clock.stage("encode"):
                made = chunks.encode_chunk(first, last)
                writer.append(last, made.tables, {**made.facts, "visible": made.visible})
        except TooLargeError:
            if last == first + 1:
                raise
            density = 1.0
            continue
        density = max(DENSER * made.visible / (nx * ny * (last - first)), LEAST_DENSITY)
    yield Progress(0.98, "Finishing the folder")
    facts = [chunk.facts for chunk in writer.chunks]
    header = members.describe_tables(
        volume, classification=quality.classification, model=quality.model, record=quality.record, axes=axes,
        unit_length=unit_length(volume, scene.index_to_world), transfer_function=scene.transfer_function.to_json(),
        lighting=describe_lighting(scene), source=source,
    )  # fmt: skip
    header |= chunks.header(facts)
    header |= {"visible": sum(one["visible"] for one in facts), members.COARSE: has_coarse}
    with clock.stage("encode"):
        size = writer.finish(header)
    return _report(scene, quality, facts, size, resumed, len(writer.chunks), clock)


def _coarse_steps(scene: Scene, quality: Quality, path, axes, source: str):
    """Generator of Progress: encode a volume of more than COARSE_VOXELS in larger voxels, too, into a folder ``path``;
    return whether there is one."""
    volume, function, side = scene.volume, scene.transfer_function, 1
    while math.prod(-(-count // side) for count in volume.shape_xyz) > COARSE_VOXELS:  # as reduced_steps makes them
        side *= 2
    if side > 1 and not is_folder_form(path):
        factors = tuple(min(side, count) for count in volume.shape_xyz)
        larger = yield from announce(reduce_steps(volume, factors), 0.0, 0.5, "Averaging voxels")
        # Voxels further apart would be less dense by themselves.
        distance = float(function.opacity_unit_distance or volume.spacing.min())
        scene = replace(scene, volume=larger, transfer_function=replace(function, opacity_unit_distance=distance))
        yield from rescale(encode_folder_steps(scene, quality, path, axes, source), 0.5, 1.0)
    return side > 1


def _check(scene: Scene, quality: Quality) -> None:
    """RleSplatError for scenes that a chunk alone does not show."""
    if is_mixed(scene) or not scene.volume.holds_values:
        raise RleSplatError("A folder of tables holds one volume without labels and channels; leave them out.")
    if shadow_count(scene):
        raise RleSplatError(
            "Shadows and ambient occlusion need all voxels at once, which a folder of tables is made without; leave "
            "them out."
        )


def _job(scene: Scene, quality: Quality, axes) -> dict:
    """All that the tables depend on."""
    described = {
        "volume": scene.volume.key, "function": scene.transfer_function.to_json(),
        "lighting": describe_lighting(scene), "matrix": scene.index_to_world.tolist(), "mode": scene.mode,
        "version": RELEASE,
        "quality": [quality.classification, quality.model, quality.record], "axes": list(axes),
    }  # fmt: skip
    content = json.dumps(described, sort_keys=True, default=str)
    return {"job": hashlib.blake2b(content.encode(), digest_size=16).hexdigest()}


def _report(scene: Scene, quality: Quality, facts, size: int, resumed: int, chunks: int, clock: Clock) -> dict:
    visible = sum(one["visible"] for one in facts)
    return {
        "stages_ms": clock.report(),
        "volume": {
            "shape_xyz": list(scene.volume.shape_xyz), "visible_voxels": visible,
            "visible_fraction": visible / math.prod(scene.volume.shape_xyz),
        },
        "classification": quality.classification, "model": quality.model, "record": quality.record,
        "folder": {"bytes": size, "slabs": chunks, "resumed_at_plane": resumed},
    }  # fmt: skip


# --- chunks -----------------------------------------------------------------------------------------------------------


class _Chunks:
    """The stages of a chunk; the base class of both classifications."""

    def __init__(self, scene: Scene, quality: Quality, axes):
        self.scene, self.volume = scene, scene.volume
        self.quality, self.axes = quality, axes
        self.threads = quality.threads
        self.falling = scene_lighting(scene, scene.index_to_world)
        self.dtypes: dict[str, list] = {}
        record = quality.record if quality.classification == "pre" else 0
        self.planned = PlannedTables(record, 1 + (0 in axes), self.falling is not None)

    def planes_at_once(self, density: float = 1.0) -> int:
        """Planes of a chunk of which a part, ``density``, is visible, by the memory that is free."""
        nx, ny, _ = self.volume.shape_xyz
        shown = max(int(density * nx * ny), 1)
        found = VoxelCount((nx, ny, 1), self.volume.voxels.dtype, shown, shown, ny, 0)
        return max(int(SHARE * available_bytes() / estimate_tables(found, self.planned).needed), 1)

    def claim(self, part, counted) -> None:
        """TooLargeError if planes with voxels ``counted`` in their rows need more memory than is free."""
        refuse_too_much(estimate_tables(VoxelCount.in_rows(part, counted), self.planned))

    def prepare_steps(self):
        """Generator of fractions done: what all chunks depend on."""
        yield from ()

    def part(self, first: int, last: int):
        """The volume's planes [first, last) alone."""
        return replace(self.volume, voxels=self.volume.voxels[first:last])

    def in_volume(self, local: VisibleVoxels, first: int) -> VisibleVoxels:
        """Voxels of a chunk from plane ``first`` on, as the only ones that are visible in the volume."""
        nx, ny, nz = self.volume.shape_xyz
        begin, end = first * ny, first * ny + len(local.row_pieces)
        row_pieces = np.zeros(nz * ny, np.int32)
        row_pieces[begin:end] = local.row_pieces
        row_start = self._rows_among(local, first, nz)
        return VisibleVoxels((nx, ny, nz), row_start, row_pieces, local.column, local.stored, local.nan_voxels)

    def _rows_among(self, local: VisibleVoxels, before: int, planes: int) -> np.ndarray:
        """The ``row_start`` of voxels of a chunk among so many ``planes``, some of which are ``before`` the chunk."""
        ny = self.volume.shape_xyz[1]
        after = planes * ny + 1 - before * ny - len(local.row_start)
        return np.pad(local.row_start, (before * ny, after), mode="edge")

    def name_files(self, order: str, tables: RunTables, **of_voxels) -> dict:
        """The tables of an order by the names of their files."""
        named = {f"{order}.{members.COUNTS}": counts_of(tables).reshape(-1, 2), f"{order}.{members.RUNS}": tables.runs}
        named |= {f"{order}.{name}": array for name, array in of_voxels.items()}
        self.dtypes |= {name: members.words_of_entry(array) for name, array in named.items()}
        return named

    def header(self, facts) -> dict:
        """Entries of the header beside those of every folder; ``facts``: of each chunk."""
        if not self.dtypes:  # every chunk was there already; a plane has all tables
            self.encode_chunk(0, 1)
        return {"dtypes": self.dtypes}


class _ClassifiedChunks(_Chunks):
    """Records of voxels that are classified first, as in the paper."""

    def __init__(self, scene: Scene, quality: Quality, axes):
        super().__init__(scene, quality, axes)
        self.source = make_scan_source(scene, quality)
        self.length = unit_length(scene.volume, scene.index_to_world)
        self.decoding = None

    def prepare_steps(self):
        if self.quality.record == 16:
            return
        _, _, nz = self.volume.shape_xyz
        most_density = most_color = 0.0
        planes = self.planes_at_once()
        for first in range(0, nz, planes):  # the scales of short records are those of the whole volume
            yield first / nz
            local, lit = self._light_chunk(first, min(first + planes, nz))
            bound = lit.color_bound
            if bound is None:
                raise RleSplatError(
                    "Short voxel records of a folder need parallel lights; choose voxel records of 16 bytes, or leave "
                    "the other lights out."
                )
            if len(local):
                density = lit.classified.properties[:, DENSITY[self.quality.model]]
                most_density = max(most_density, float(density.max(initial=0.0)))
            most_color = max(most_color, bound)
        self.decoding = decoding_of(self.quality.record, most_density, most_color)

    def _light_chunk(self, first: int, last: int):
        """The visible voxels of a chunk, and the same as a LitVolume."""
        shown = Visibility(self.part(first, last), self.scene.transfer_function)
        blocks = drain(block_steps(shown.volume, threads=self.threads))
        bits = drain(mark_steps(shown, blocks, threads=self.threads))
        counted = count_kept(bits, threads=self.threads)
        self.claim(shown.volume, counted)
        local = gather_kept(shown.volume, bits, counted, blocks, threads=self.threads)
        voxels = self.in_volume(local, first)
        found = self.source.classify(self.source.shown, voxels, self.length)
        directions = None if self.falling is None else drain(self.source.normal_steps(voxels))
        return local, LitVolume(self.source, found, self.falling, normals=directions)

    def encode_chunk(self, first: int, last: int) -> _ChunkTables:
        """The tables of planes [first, last)."""
        local, lit = self._light_chunk(first, last)
        model, record, write = self.quality.model, self.quality.record, lit.write_records(self.quality.model)

        def write_chunk(positions, records):
            place = RecordPositions(
                lit.classified.voxels, first + positions.first_plane, positions.across, positions.data_starts
            )
            return write(place, records)

        tables = run_tables(local, 2, threads=self.threads)
        rows = drain(record_steps(tables, local, write_chunk, model, record, self.decoding, threads=self.threads))
        named = self.name_files(members.ROWS, tables, **{RECORDS: words_of(rows.voxel_data)})
        if 0 in self.axes:
            tables = run_tables(local, 0, threads=self.threads)
            across = drain(reorder_steps(tables, local, rows, threads=self.threads))
            named |= self.name_files(members.ACROSS, tables, **{RECORDS: words_of(across.voxel_data)})
        facts = {"most_color": rows.most_color, "nan": local.nan_voxels}
        return _ChunkTables(named, facts, len(local))

    def header(self, facts) -> dict:
        return {
            **super().header(facts), "most_color": max(one["most_color"] for one in facts),
            "nan_voxels": sum(one["nan"] for one in facts),
            "decoding": None if self.decoding is None else self.decoding.tolist(),
        }  # fmt: skip


class _ScalarChunks(_Chunks):
    """Scalars of the voxels that post-classified sheets need, and codes of their normals.

    Short gaps are not closed, so that the tables serve all depth rules.
    """

    def prepare_steps(self):
        volume, scene = self.volume, self.scene
        if scene.transfer_function.gradient_opacity is not None:
            raise RleSplatError(
                "A folder of post-classified tables has no gradient opacity; choose the classification pre, or leave "
                "it out."
            )
        self.blocks = yield from block_steps(volume, threads=self.threads)
        self.reach = Reach.of_values(volume, find_shown_values(scene.transfer_function, scene.mode))
        self.ends, self.infinite = find_value_ends(volume, scene.transfer_function, self.blocks)
        self.center = center_of(volume.voxels.dtype, self.ends)
        light_of(scene, self.falling)  # which refuses light that is too bright
        # Clip objects are not those of the folder, but of whoever draws it.
        self.faces = faces_of((), scene.index_to_world)

    def _keep_voxels(self, first: int, last: int) -> VisibleVoxels:
        """The voxels of a chunk that its own cells and those that it shares with its neighbors need."""
        _, ny, nz = self.volume.shape_xyz
        begin, end = max(first - 1, 0), min(last + 1, nz)
        around = self.part(begin, end)
        blocks = drain(block_steps(around, threads=self.threads))
        bits = drain(relevant_steps(around, self.reach, blocks, threads=self.threads))
        bits = bits[(first - begin) * ny : (last - begin) * ny]
        counted, own = count_kept(bits, threads=self.threads), self.part(first, last)
        self.claim(own, counted)
        return gather_kept(own, bits, counted, blocks, threads=self.threads)

    def encode_chunk(self, first: int, last: int) -> _ChunkTables:
        """The tables of planes [first, last)."""
        local = self._keep_voxels(first, last)
        of_voxels = {SCALARS: scalars_of(local, self.volume.voxels.dtype, self.infinite, self.center)}
        if self.falling is not None:
            of_voxels[members.SURFACE] = self._surface(local, first, last)
        named = self.name_files(members.ROWS, run_tables(local, 2, threads=self.threads), **of_voxels)
        if 0 in self.axes:
            tables = run_tables(local, 0, threads=self.threads)
            placed = {name: self._in_scanlines(tables, local, array) for name, array in of_voxels.items()}
            named |= self.name_files(members.ACROSS, tables, **placed)
        return _ChunkTables(named, {}, len(local))

    def _in_scanlines(self, tables: RunTables, local: VisibleVoxels, array: np.ndarray) -> np.ndarray:
        words = array.view(np.uint16) if array.ndim > 1 else array  # a type that kernels are compiled for
        return drain(in_scanlines(tables, local, words, threads=self.threads)).view(array.dtype)

    def _surface(self, local: VisibleVoxels, first: int, last: int) -> np.ndarray:
        """(m, 3) int16: codes of the normals of voxels of a chunk, of planes around it too."""
        scene, volume, sigma = self.scene, self.volume, smoothness_of(self.scene)
        reach = gaussian(sigma, volume.spacing[2]).size // 2 + BEYOND
        begin, end = max(first - reach, 0), min(last + reach, volume.shape_xyz[2])
        around, rows = self.part(begin, end), self._rows_among(local, first - begin, end - begin)
        if volume.voxels.dtype.name not in OWN_TYPES[:-1]:
            around.measured["value_range"] = volume.value_range  # by which values are scaled: as in the whole volume
        surfaces = drain(surface_steps(around, rows, local.column, sigma, threads=self.threads))
        function, matrix, voxels = scene.transfer_function, scene.index_to_world, self.in_volume(local, first)
        given = surfaces, voxels, volume, function, matrix, self.faces
        return drain(place_steps(*given, with_points=False, threads=self.threads))[0]

    def header(self, facts) -> dict:
        found, volume, matrix = super().header(facts), self.volume, self.scene.index_to_world.tolist()
        return {
            **found, "stored_type": volume.voxels.dtype.name, "slope": volume.slope, "intercept": volume.intercept,
            "ends": list(self.ends), "center": self.center, "nan_voxels": self.blocks.nan_voxels,
            "light": None if self.falling is None else {"model": members.LIGHT_MODEL, "index_to_world": matrix},
        }  # fmt: skip
