"""Whether an object is still in use: Blender's Delete only takes it out of its scenes, and our pointers keep it."""

from __future__ import annotations

import bpy


def is_deleted(one) -> bool:
    """Whether no scene reaches the object, neither directly nor through an instanced collection."""
    return not _reached(one, set())


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
