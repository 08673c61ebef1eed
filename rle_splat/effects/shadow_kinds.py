"""The effects that shadows, the world's light, ambient occlusion and indirect light are."""

from collections import Counter

from ..scene import Quality, Scene
from ..scene.changed import change
from .kind import Kind
from .lighting_kinds import idle_because

MANY = 16  # lights that cast shadows, above which the effect's reason has their price


def _shadows(scene: Scene, _: Quality) -> tuple[bool, str]:
    reason = idle_because(scene)
    casting = Counter(light.type.lower() for light in scene.lights if light.casts_shadow and light.energy > 0.0)
    if reason is None and not scene.volume_shadows:
        reason = "shadows are turned off"
    if reason is None and not casting:
        reason = "no light casts shadows" if scene.lights else "a headlight casts no shadows"
    if reason is not None:
        return False, reason
    meshes = ", the meshes' too" if scene.triangles is not None and len(scene.triangles) else ""
    price = ": each takes a sweep through the volume, and memory" * (casting.total() > MANY)
    return True, f"cast by {', '.join(f'{number} {kind}' for kind, number in casting.items())}{meshes}{price}"


def _world(scene: Scene, _: Quality) -> tuple[bool, str]:
    if scene.world is None or not any(scene.world):
        return False, "the scene has no world light" if scene.world is None else "the world is black"
    reason = idle_because(scene)
    radiance = ", ".join(f"{part:.4g}" for part in scene.world)
    around = "from all directions" if scene.environment is None else "on average, by spherical harmonics of order 2"
    return reason is None, reason or f"radiance {radiance} {around}"


def _ambient_occlusion(scene: Scene, _: Quality) -> tuple[bool, str]:
    reason = idle_because(scene)
    if reason is None and scene.ambient_occlusion == 0.0:
        reason = "ambient occlusion is turned off"
    if reason is None and scene.world is None and scene.transfer_function.shade.ambient == 0.0:
        reason = "there is no ambient light"
    return reason is None, reason or f"strength {scene.ambient_occlusion:g}"


def _force_occlusion(scene: Scene) -> Scene:
    return scene if scene.ambient_occlusion > 0.0 else change(scene, ambient_occlusion=1.0)


def _indirect_light(scene: Scene, quality: Quality) -> tuple[bool, str]:
    reason = idle_because(scene)
    if reason is None and scene.indirect_light == 0.0:
        reason = "indirect light is turned off"
    if reason is None and not _shadows(scene, quality)[0]:
        reason = "only light that casts shadows is scattered, and none does"
    if reason is None and quality.classification == "pre":
        reason = "the volume is pre-classified"
    return reason is None, reason or f"amount {scene.indirect_light:g}"


def _force_indirect(scene: Scene) -> Scene:
    return scene if scene.indirect_light > 0.0 else change(scene, indirect_light=1.0)


SHADOWS = Kind(
    "Let the volume and meshes cast shadows on the volume", _shadows,
    lambda scene: change(scene, volume_shadows=False), stage="shadows",
    with_default=lambda scene: change(scene, volume_shadows=True),
)  # fmt: skip
WORLD = Kind(
    "Light the volume from all sides with the world",
    _world,
    lambda scene: change(scene, world=None, environment=None),
)
AMBIENT_OCCLUSION = Kind(
    "Darken ambient and world light where the volume or a mesh blocks them", _ambient_occlusion,
    lambda scene: change(scene, ambient_occlusion=0.0), stage="ambient occlusion", with_default=_force_occlusion,
)  # fmt: skip
INDIRECT_LIGHT = Kind(
    "Scatter light on its way through the volume, so that skin, fat and thin parts are translucent", _indirect_light,
    lambda scene: change(scene, indirect_light=0.0), with_default=_force_indirect,
)  # fmt: skip
