"""Source of a folder of post-classified tables: scalars and codes of their normals, encoded already."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..classify.classification import opacity_distance, unit_length
from ..classify.lookup_table import lookup_table
from ..classify.transfer_function import TransferFunction
from ..encode.members import SURFACE, make_damage_error
from ..encode.scalars import ScalarVolume
from ..scene import Environment, Light, Quality, RleSplatError, Scene, as_color
from ..shade.lighting import lighting
from ..shade.sample_light import SampleLight, sample_light
from ..shade.shading import refuse_too_bright
from ..view.projection import world_to_camera
from .file_source import FileSource
from .lighting import eye_of
from .medium import ScalarVoxels, mist_color
from .source import Work

VALUES_ALREADY = "A .rle folder holds the voxels that its transfer function needs, and its lights: post."


@dataclass(frozen=True, eq=False)
class ScalarFileSource(FileSource):
    """The tables of a folder, whose transfer function is what it is."""

    scalar_sheets = True
    light: SampleLight | None = None  # of a folder that is lit, once it is shaded

    @classmethod
    def of(cls, scene: Scene, quality: Quality, *more) -> ScalarFileSource:
        if quality.classification != "post":
            raise RleSplatError(
                "This .rle folder holds values that are classified in the picture; render it with the classification "
                "post, or encode the volume again."
            )
        return cls(scene, quality, *more)

    @property
    def remarks(self) -> tuple[str, ...]:
        return (*self.scene.volume.remarks, VALUES_ALREADY)

    @property
    def nan_voxels(self) -> int:
        return self.scene.volume.nan_voxels

    def classify_steps(self, work: Work):
        """Generator of nothing: the folder as it is, whose values are classified where they are interpolated."""
        yield from ()
        return self

    def shade_steps(self, voxels: ScalarFileSource, work: Work):
        """Generator of nothing: the ScalarVoxels of the folder, under its own lights."""
        yield from ()
        scene, stored, values = self.scene, self.scene.volume, self.scene.volume.values
        volume, function = stored.stand_in, scene.transfer_function
        length = unit_length(stored, scene.index_to_world)
        table = lookup_table(volume, function, values.ends, opacity_distance(volume, function, length))
        light = self._light()
        shine = (1.0, 0.0) if light is None else (light.most_light, light.most_highlight)
        brightest = refuse_too_bright(table.most_color * shine[0] + shine[1] if values.ends[0] < values.ends[1] else
                                      table.most_color)  # fmt: skip
        most_color = max(brightest, *mist_color(scene.mist))
        return ScalarVoxels(replace(voxels, light=light), self.quality, scene.mist, table, most_color)

    def encode_steps(self, axis: int):
        """Generator of fractions done: the ScalarVolume of a principal axis."""
        self.refuse_without(axis)
        tables, of_voxels = yield from self.scene.volume.tables_steps(axis)
        center, codes = self.scene.volume.values.center, None if self.light is None else of_voxels[SURFACE]
        return ScalarVolume(tables, of_voxels["scalars"], center, codes, self.light)

    def _light(self) -> SampleLight | None:
        """The folder's own lights, which turn with it, and its headlight, as they are seen from this camera."""
        scene, stored = self.scene, self.scene.volume
        if not stored.holds_normals:
            return None
        matrix = scene.index_to_world if stored.values.light_matrix is None else stored.values.light_matrix
        # Where the codes are: they do not turn with the volume.
        turn = np.eye(4)
        if not np.array_equal(matrix, scene.index_to_world):
            turn = matrix @ np.linalg.inv(scene.index_to_world)
        described, shade = stored.lighting, TransferFunction.from_json(stored.transfer_function).shade
        try:
            looking = None
            if described["headlight_direction"] is not None:
                looking = turn[:3, :3] @ -world_to_camera(scene.camera)[2, :3]
            lights = [Light(**entry) for entry in described["lights"]]
            world, around = described.get("world"), described.get("environment")
            falling = lighting(
                matrix, shade, lights, headlight_direction=looking, eye=turn @ eye_of(scene.camera),
                world=None if world is None else as_color(world, "The light of its world"),
                environment=None if around is None else Environment(**around),
            )  # fmt: skip
        except (LookupError, TypeError, ValueError):
            raise make_damage_error(stored.path, "its lights are not described") from None
        return None if falling is None else sample_light(falling, stored.shape_xyz)
