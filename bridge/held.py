"""References to datablocks that survive undo and renaming during a job or a timer.

Undo invalidates Python references to datablocks, and names can change.  Blender's session id stays the same until the
file is closed.
"""

import bpy

from ..rle_splat.scene import RleSplatError


class Held:
    """A reference to one object, scene, image or world by its session id.

    Parameters
    ----------
    datablock : bpy.types.Object, bpy.types.Scene, bpy.types.Image or bpy.types.World
        The datablock.
    """

    def __init__(self, datablock):
        self.name = datablock.name
        self._kind = {
            "OBJECT": "objects", "SCENE": "scenes", "IMAGE": "images", "WORLD": "worlds",
        }[datablock.id_type]  # fmt: skip
        self._session_uid = datablock.session_uid

    def find(self):
        """The datablock, or None if it was removed."""
        return next((one for one in getattr(bpy.data, self._kind) if one.session_uid == self._session_uid), None)

    def get(self):
        """The datablock; RleSplatError if it was removed."""
        found = self.find()
        if found is None:
            raise RleSplatError(f"{self.name!r} was removed meanwhile, so its picture was dropped; make it again.")
        return found
