"""Detects deleted objects: Blender's Delete only unlinks an object from its scenes, and our pointers keep it alive."""

import bpy


def is_deleted(one) -> bool:
    """Whether an object is in no scene, neither directly nor through an instanced collection."""
    return not _reached(one, set())


def is_kept_up(one, depsgraph) -> bool:
    """Whether Blender evaluates an object; one that is disabled in viewports keeps an outdated matrix.

    Always True in a render's depsgraph.
    """
    if depsgraph.mode == "RENDER":
        return True
    return not one.hide_viewport and _is_enabled(one, depsgraph.view_layer.layer_collection)


def _is_enabled(one, layer_collection) -> bool:
    """Whether a collection of a view layer, or one of its children, is enabled and holds the object."""
    if layer_collection.collection.hide_viewport:
        return False
    held = not layer_collection.exclude and one in layer_collection.collection.objects.values()
    return held or any(_is_enabled(one, child) for child in layer_collection.children)


def _reached(one, asked: set) -> bool:
    if one.users_scene:
        return True
    asked.add(one)
    holders = _collections_of(one)
    if not holders:
        return False
    return any(
        other.instance_collection in holders and other not in asked and _reached(other, asked)
        for other in bpy.data.objects
        if other.instance_type == "COLLECTION" and other.instance_collection is not None
    )


def _collections_of(one) -> set:
    """Every collection that holds the object, directly or in a child."""
    holders, new = set(), set(one.users_collection)
    while new:
        holders |= new
        new = {parent for parent in bpy.data.collections if any(c in new for c in parent.children)} - holders
    return holders
