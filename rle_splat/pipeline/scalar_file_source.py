"""Source of a folder of post-classified tables: scalars and the light on them, encoded already."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ..classify.classification import opacity_distance, unit_length
from ..classify.lookup_table import lookup_table
from ..classify.transfer_function import TransferFunction
from ..encode.members import damaged
from ..encode.scalars import ScalarVolume
from ..scene import Light, Quality, RleSplatError, Scene
from ..shade.lighting import lighting
from ..shade.normal_light import NormalLight, normal_light
from ..shade.shading import refuse_too_bright
from ..view.projection import world_to_camera
from .file_source import FileSource
from .lighting import eye_of
from .medium import ScalarVoxels, mist_color
from .source import Work

VALUES_ALREADY = "A .rle folder holds the voxels that its transfer function needs, and their light: post."


@dataclass(frozen=True, eq=False)
class ScalarFileSource(FileSource):
    """The tables of a folder, whose transfer function is what it is."""

    scalar_sheets = True
    light: NormalLight | None = None  # of a folder that holds normals, once it is shaded

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
        light = self._normal_light()
        shine = (1.0, 0.0) if values.light is None else values.light[1:]
        if light is not None:
            shine = light.most_light, light.most_highlight
        brightest = refuse_too_bright(table.most_color * shine[0] + shine[1] if values.ends[0] < values.ends[1] else
                                      table.most_color)  # fmt: skip
        most_color = max(brightest, *mist_color(scene.mist))
        return ScalarVoxels(replace(voxels, light=light), self.quality, scene.mist, table, most_color)

    def encode_steps(self, axis: int):
        self.refuse_without(axis)
        return self._with_light(*(yield from self.scene.volume.tables_steps(axis)), self.light)

    def _with_light(self, tables, of_voxels: dict, light: NormalLight | None) -> ScalarVolume:
        """The tables of a principal axis with their light, if there is any."""
        values, scalars = self.scene.volume.values, of_voxels["scalars"]
        if light is not None:
            none = light.no_codes
            lamps = light.lamps(of_voxels["normals"], tables.axis)
            return ScalarVolume(tables, scalars, values.center, none, lamps=lamps)
        if values.light is None:
            return ScalarVolume(tables, scalars, values.center)
        return ScalarVolume(tables, scalars, values.center, of_voxels["light"], values.light[0])

    def _normal_light(self) -> NormalLight | None:
        """The light of a folder that holds normals: its own lights, seen from this camera."""
        scene, stored = self.scene, self.scene.volume
        if not stored.holds_normals:
            return None
        described, shade = stored.lighting, TransferFunction.from_json(stored.transfer_function).shade
        try:
            looking = None if described["headlight_direction"] is None else -world_to_camera(scene.camera)[2, :3]
            lights = [Light(**entry) for entry in described["lights"]]
        except (LookupError, TypeError):
            raise damaged(stored.path, "its lights are not described") from None
        falling = lighting(
            scene.index_to_world, shade, lights, headlight_direction=looking, eye=eye_of(scene.camera)
        )
        return normal_light(falling, stored.shape_xyz)
