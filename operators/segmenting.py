"""What operators share that make segments: the label map is read, changed and written in steps, then shown."""

from ..bridge.held import Held
from ..bridge.translations import filled
from ..bridge.volumes import loading, segments, volumes
from .reading import TakesVoxels
from .refusal import has_editable_values

UNSAVED = "The segments are in Blender's temporary folder; save the .blend to keep them."


class MakesSegments(TakesVoxels):
    """Mix-in for operators that add or change a segment of a volume.

    A subclass defines ``changes(context, owner, volume)``: a dict of the arguments of ``segments.change_steps`` after
    the volume.
    """

    bl_options = {"UNDO"}  # without REGISTER: Adjust Last Operation (F9) would make it again
    is_new = False  # Blender pushes the undo step, for UNDO is among ``bl_options``
    hide = ""  # as of ``segments.show``

    poll = classmethod(has_editable_values)

    def loading(self, context):
        owner = volumes.volume_object(context)
        return loading.missing_steps(owner, with_labels=bool(owner.rle_splat.label_file))

    def prepare(self, context):
        owner = volumes.volume_object(context)
        self._owner, self._volume = Held(owner), volumes.load_volume(owner)
        return segments.change_steps(owner, self._volume, **self.changes(context, owner, self._volume))

    def commit(self, _context, made):
        owner = self._owner.get()
        segments.show(owner, self._volume, made, self.hide)
        row = owner.rle_splat.labels[owner.rle_splat.active_label]
        count = int((made.found.volume.voxels == made.number).sum())
        self.report({"INFO"}, filled("{segment} has {count} voxels.", segment=row.label_name, count=f"{count:,}"))
        if segments.is_temporary(made.path):
            self.report({"WARNING"}, UNSAVED)
