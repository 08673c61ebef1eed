"""Datablocks held across a job or a timer.

No Python reference to a datablock survives undo, and names change.  Blender's session id does neither: it stays the
same through undo and renaming until the file is closed.
"""

from __future__ import annotations

import bpy

from ..rle_splat.scene import RleSplatError


class Held:
    """One object, scene or image, found again by its session id."""

    def __init__(self, datablock):
        self.name = datablock.name
        self._kind = {"OBJECT": "objects", "SCENE": "scenes", "IMAGE": "images"}[datablock.id_type]
        self._session_uid = datablock.session_uid

    def find(self):
        """The datablock, or None when it is gone."""
        return next((one for one in getattr(bpy.data, self._kind) if one.session_uid == self._session_uid), None)

    def get(self):
        """The datablock.  Raises RleSplatError when it is gone."""
        found = self.find()
        if found is None:
            raise RleSplatError(f"{self.name!r} is no longer there, so its picture was dropped.")
        return found
