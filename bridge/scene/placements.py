"""Where volumes stand in a scene: each volume object itself, and where instances of collections show it again."""

from typing import NamedTuple

import numpy as np

from ..volumes import channels
from . import render_scene


class Placement(NamedTuple):
    """A volume in one place.

    Attributes
    ----------
    matrix : (4, 4) ndarray of float64 or None
        Its matrix in the world; None for that of the object itself.
    instancer : bpy.types.Object or None
        The object that shows an instance of it.
    """

    owner: object
    matrix: np.ndarray | None = None
    instancer: object | None = None

    @property
    def stands_for(self):
        """The object of the scene by which the volume is shown or hidden."""
        return self.owner if self.instancer is None else self.instancer


def placements(depsgraph) -> list[Placement]:
    """The volumes of an evaluated scene, in its order.

    Blender leaves out what is hidden: in a render what is hidden from renders, in a viewport what is hidden there.  Of
    an instance that is the setting of the instancer and that of the object in the collection.
    """
    found = []
    for instance in depsgraph.object_instances:
        owner = instance.object.original
        if owner.type != "EMPTY" or not owner.rle_splat.is_volume:
            continue
        if not instance.is_instance:
            found.append(Placement(owner))
        elif instance.show_self:
            matrix = np.array(instance.matrix_world, np.float64)
            found.append(Placement(owner, matrix, instance.parent.original))
    return found


def shown(depsgraph) -> list[Placement]:
    """The volumes that a render of a view layer shows, by the rules of Cycles, by name; no channels of others."""
    found = [one for one in placements(depsgraph) if why_hidden(one, depsgraph) is None]
    added = as_channels([one.owner for one in found])
    found = [one for one in found if one.owner not in added]
    return sorted(found, key=lambda one: (one.instancer is not None, one.owner.name, one.stands_for.name))


def as_channels(owners: list) -> list:
    """Of volume objects that are visible, those that others of them show as channels, so that they are not drawn twice.

    Of two that are each other's channels one is left.
    """
    added: list = []
    for owner in dict.fromkeys(owners):
        others = [one for one in owners if one != owner and one not in added]
        if any(owner in channels.sources_of(other) for other in others):
            added.append(owner)
    return added


def why_hidden(placed: Placement, depsgraph) -> str | None:
    """Why a view layer does not show a volume, by the rules of Cycles; None if it shows it."""
    layer, scene, one = depsgraph.view_layer, depsgraph.scene, placed.stands_for
    where = f"view layer {layer.name!r}"
    if scene not in one.users_scene:
        return f"it is not in the scene {scene.name!r}"
    if not any(other == one for other in layer.objects):
        return f"it is excluded from {where}"
    if placed.instancer is None and not render_scene.is_rendered(one, depsgraph):
        return f"it is hidden from renders in {where}"
    if one.indirect_only_get(view_layer=layer) or not (one.visible_camera and placed.owner.visible_camera):
        return f"it is hidden from the camera in {where}"
    if one.holdout_get(view_layer=layer) or one.is_holdout or placed.owner.is_holdout:
        return f"it is a holdout in {where}, which RLE Splat does not support"
    if not layer.use_volumes:
        return f"{where} has volumes switched off (Filter > Volumes)"
    return None
