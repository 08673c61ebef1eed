"""The volume's shadow and reflection on meshes: a Volume object that all rays see but the camera's.

Renders combine our picture with that of the engine, which knows nothing of the volume.  So a child of the volume object
holds a coarse grid of its medium: rays from meshes to lights are absorbed in it, and mirrors see its lit color.

EEVEE casts no shadows of grids, and Cycles none on a point inside a grid that its camera does not see.  For them a
child of the grid is the surface at which a voxel of the grid lets half of the light through.  Cycles has it moved
inward, so that it does not shade what lies on the volume; beyond, its shadow is that of the grid.

Both objects are there as long as renders include the volume.  What they show is set before each rendered frame, on the
render thread, and is a file or nothing; see ``over_render.py`` for what may be done there.  They are disabled in
viewports, so they are neither drawn nor framed nor selected there.

Files are named after a hash of all that decides their content.  They are beside the .blend, or in the extension's
folder before its first save.
"""

import time
from collections import Counter
from contextlib import suppress
from pathlib import Path

import bpy
import numpy as np
from bpy.app.handlers import persistent

from ...rle_splat.effects.lighting_kinds import BAKED
from ...rle_splat.pipeline.medium_grid import for_any_view, shadow_factors
from ...rle_splat.runtime.array_hash import hash_plain
from ...rle_splat.runtime.steps import drain
from ...rle_splat.scene import MODES, Scene
from .. import linked, paths
from ..data import effects
from ..scene.clip_objects import clip_objects
from ..scene.lights import read_lights
from ..scene.meshes import seen_meshes, takes_light
from ..volumes import volumes
from ..volumes.source_paths import kept_path
from . import medium_volumes

GRID_ENGINES = ("CYCLES",)  # that cast shadows of grids and hide them from the camera
SURFACE_ENGINES = ("BLENDER_EEVEE", "BLENDER_EEVEE_NEXT")  # that do so with surfaces alone
FOLDER = "volume shadows"
PREFIX, SUFFIX = "shadow-", ".vdb"
RECENT = 120.0  # seconds
INWARD = 1.5  # voxels of the grid; with less, a plate on bone gets dark spots
AROUND = 8.0  # voxels of the grid around its box in which Cycles may be inside it, a leaf of OpenVDB
KEPT = 4  # files that no object shows any more; an earlier state of the scene may want them again

_saved: dict = {}  # session id of a grid -> its file, while the .blend is saved


def grids(scene) -> list:
    """The objects of a scene that hold a volume's medium for shadows, sorted by name."""
    found = (one for one in scene.objects if one.rle_splat.is_shadow_grid and one.type == "VOLUME")
    return sorted(found, key=lambda one: one.name)


def surface_of(grid):
    """The surface of a grid; None if somebody has removed it or a modifier of it."""
    return next((one for one in grid.children if one.type == "MESH" and len(one.modifiers) > 1), None)


def settle(scene) -> None:
    """Give each volume in renders its grid, and remove all others, such as those of deleted volumes."""
    is_off = effects.forced(scene, effects.SHADOWS_ON_MESHES) is False
    owners = volumes.volume_objects(scene) if scene.rle_splat.use_composite and not is_off else []
    kept: dict = {}  # volume object -> its grid
    for one in grids(scene):
        if linked.is_own(one):
            if one.parent in owners and one.parent not in kept:
                kept[one.parent] = one
            else:
                _remove(one)
    for one in tuple(scene.objects):  # surfaces of grids that are gone, whoever removed them, and incomplete ones
        if one.rle_splat.is_shadow_grid and one.type == "MESH" and linked.is_own(one):
            if one.parent not in kept.values() or one != surface_of(one.parent):
                _remove(one)
    for owner in owners:
        grid = kept.get(owner) or _add(scene, owner)
        if grid.data.users > 1:  # of a copied volume
            grid.data = grid.data.copy()
        if surface_of(grid) is None:
            _add_surface(grid)


def _add(scene, owner):
    title = f"{owner.name[: medium_volumes.LONGEST_NAME]} Shadow"
    # In 5.2 EEVEE shows volumes to the camera that are hidden from it.
    one = medium_volumes.new_object(title, medium_volumes.emitting_material(title, GRID_ENGINES[0]))
    one.visible_transmission = False  # our picture is seen through glass, and the coarse grid would surround it
    homes = [home for home in owner.users_collection if linked.is_own(home)]
    _attach(one, owner, homes or [scene.collection])
    return one


def _add_surface(grid) -> None:
    title = f"{grid.name} Surface"
    one = bpy.data.objects.new(title, bpy.data.meshes.new(title))
    modifier = one.modifiers.new("Surface", "VOLUME_TO_MESH")
    modifier.object, modifier.resolution_mode = grid, "GRID"
    modifier.show_render = False
    one.modifiers.new("Inward", "DISPLACE").mid_level = 0.0
    one.visible_diffuse = one.visible_glossy = one.visible_transmission = one.visible_volume_scatter = False
    _attach(one, grid, grid.users_collection)


def _attach(one, parent, homes) -> None:
    for home in homes:
        home.objects.link(one)
    one.parent = parent
    one.rle_splat.is_shadow_grid = True
    one.visible_camera = False
    one.hide_viewport = one.hide_select = True


def _remove(one) -> None:
    """Remove a grid or a surface with its data and material."""
    data = one.data
    bpy.data.objects.remove(one)
    if data is not None and data.users == 0:
        materials = [material for material in data.materials if material is not None]
        bpy.data.batch_remove([data])
        bpy.data.batch_remove([material for material in materials if material.users == 0])


def why(owner, depsgraph, plain: Scene) -> tuple[bool, str]:
    """Whether the engine gets to see a volume, and why or why not."""
    scene = depsgraph.scene
    by_hand = effects.forced(scene, effects.SHADOWS_ON_MESHES)
    if by_hand is False:
        return False, "by hand"
    reason = _impossible_because(scene, owner, plain)
    if reason:
        return False, reason
    casting = Counter(light.type.lower() for light in read_lights(depsgraph) if light.casts_shadow)
    if plain.environment is not None:
        casting["environment"] += 1
    reason = f"cast by {', '.join(f'{number} {kind}' for kind, number in casting.items())}"
    if scene.render.engine in SURFACE_ENGINES:
        reason += ", of an opaque surface in EEVEE"
    if not casting:
        reason = "no light casts shadows"
    elif next(_receivers(depsgraph), None) is None:
        reason, casting = "no mesh can receive them", ()
    return bool(by_hand) or bool(casting), f"by hand: {reason}" if by_hand else reason


def _receivers(depsgraph):
    """Generator of the instances of meshes that a shadow can fall on, which those that emit alone do not show."""
    for instance in seen_meshes(depsgraph, clip_objects(depsgraph.scene)):
        slots = instance.object.material_slots
        if not slots or any(takes_light(slot.material) for slot in slots):
            yield instance


def _is_around(instance, to_grid, shape_xyz) -> bool:
    """Whether the bounds of a mesh meet those of a grid; ``to_grid``: (4, 4), world to indices of voxels."""
    to_index = to_grid @ np.array(instance.matrix_world)
    corners = np.array([corner[:] for corner in instance.object.bound_box]) @ to_index[:3, :3].T + to_index[:3, 3]
    is_below = corners.max(axis=0) < -AROUND
    return not (is_below | (corners.min(axis=0) > np.asarray(shape_xyz) + AROUND)).any()


def _impossible_because(scene, owner, plain: Scene) -> str:
    if not scene.rle_splat.use_composite or scene not in owner.users_scene:
        return "renders do not include the volume"
    if scene.render.engine not in GRID_ENGINES + SURFACE_ENGINES:
        return "this render engine casts none"
    if plain.mode != MODES[0]:
        return "the mode shows no surfaces"
    if not plain.volume.holds_values:
        return BAKED
    if not any(one.parent == owner and linked.is_own(one) for one in grids(scene)):
        return "the scene is linked from another file"
    return ""


def update(shown: list, depsgraph, quality) -> dict:
    """Have grids show what volumes do at the depsgraph's time, if the effect is on; returns it as reports list effects.

    Parameters
    ----------
    shown : list of (bpy.types.Object, Scene)
        The volumes that a view layer shows, each with what its picture depends on.
    quality : Quality
        Its threads count.

    Raises
    ------
    RleSplatError
        If a grid cannot be made or saved; it is empty then.
    """
    began, files, on, reason = time.perf_counter(), {}, False, "only instances of volumes are shown"
    try:
        for owner, plain in shown:
            casts, words = why(owner, depsgraph, plain)
            if casts:
                factors = shadow_factors(plain, read_lights(depsgraph))
                own = medium_volumes.grid_matrix(plain, factors)
                to_grid, size = np.linalg.inv(plain.volume_matrix @ own), plain.volume.shape_xyz / np.array(factors)
                inside = any(_is_around(instance, to_grid, size) for instance in _receivers(depsgraph))
                voxel = float(np.cbrt(abs(np.linalg.det(own[:3, :3]))))
                files[owner] = _file_of(plain, quality, factors), voxel, inside
            on, reason = (on or casts), (reason if on else words)
    finally:
        show(depsgraph.scene, files)
    return row(on, reason, 1000.0 * (time.perf_counter() - began) if on else 0.0)


def row(on: bool, reason: str, ms: float | None = 0.0) -> dict:
    """The effect as reports list effects, with its own milliseconds, None if they are not known."""
    return {"name": effects.SHADOWS_ON_MESHES, "on": on, "reason": reason, "ms": ms}


def show(scene, files: dict | None = None) -> None:
    """Have the grids of volumes show files, and all others of the scene show nothing.

    ``files``: volume object to its file, the side of a voxel of it in the volume's own space, and whether a mesh is
    inside it.
    """
    for one in grids(scene):
        path, voxel, inside = (files or {}).get(one.parent, (None, 1.0, False))
        shown = "" if path is None else kept_path(str(path), bpy.data.filepath)
        if one.data is not None and linked.is_own(one.data) and one.data.filepath != shown:
            one.data.filepath = shown
        surface = surface_of(one)
        if surface is not None and linked.is_own(surface):
            modifier, inward = surface.modifiers[:2]
            modifier.threshold, inward.strength = float(np.log(2.0)) / voxel, -INWARD * voxel
            is_outline = scene.render.engine in SURFACE_ENGINES
            modifier.show_render, inward.show_render = bool(shown) and (inside or is_outline), not is_outline


def _file_of(plain: Scene, quality, factors) -> Path:
    """The file of a scene's medium, which is made if there is none."""
    scene = for_any_view(plain)
    turned = medium_volumes.density_factor(plain.volume_matrix), medium_volumes.grid_matrix(plain, factors)
    path = _folder() / f"{PREFIX}{hash_plain(scene, factors, turned)}{SUFFIX}"
    if not path.is_file():
        drain(medium_volumes.file_steps(plain, quality, factors, path))
        _delete_unused(path)
    return path


def _folder() -> Path:
    """Where the files are: beside the .blend, or where the extension may write."""
    if bpy.data.filepath:
        return Path(bpy.data.filepath).parent / f"{Path(bpy.data.filepath).stem} {FOLDER}"
    return (paths.extension_folder() or Path(bpy.app.tempdir)) / FOLDER


def _delete_unused(newest: Path) -> None:
    """Delete all but the latest of the files that no object shows.

    Not the recent ones: another Blender that renders the same .blend may have made one and not loaded it yet.
    """
    shown = {Path(bpy.path.abspath(data.filepath)) for data in bpy.data.volumes if data.filepath} | {newest}
    made = {}
    for path in newest.parent.glob(f"{PREFIX}*{SUFFIX}"):
        with suppress(FileNotFoundError):  # the other one deletes, too
            made[path] = path.stat().st_mtime
    for path in sorted(made.keys() - shown, key=made.get)[:-KEPT]:
        if made[path] < time.time() - RECENT:
            with suppress(PermissionError):  # another Blender on Windows shows it
                path.unlink(missing_ok=True)


@persistent
def _on_save_pre(*_arguments):
    """Save grids empty: a render without this extension shows neither the volume nor a shadow of what it was."""
    for data in _own_data():
        _saved[data.session_uid], data.filepath = data.filepath, ""


@persistent
def _on_save_post(*_arguments):
    for data in _own_data():
        data.filepath = _saved.get(data.session_uid, "")
    _saved.clear()


def _own_data() -> list:
    return [
        one.data
        for one in bpy.data.objects
        if one.type == "VOLUME" and one.rle_splat.is_shadow_grid and linked.is_own(one.data)
    ]


HANDLERS = (("save_pre", _on_save_pre), ("save_post", _on_save_post), ("save_post_fail", _on_save_post))
