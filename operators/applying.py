"""What the operators that replace a volume's transfer function have in common."""

from ..bridge.look import transfer
from ..bridge.volumes import volumes
from .reading import LoadsFirst
from .refusal import has_editable_values, refuses


class AppliesTransfer(LoadsFirst):
    """Gives the volume the transfer function that ``chosen`` returns for it, and why it was chosen."""

    bl_options = {"REGISTER", "UNDO"}

    poll = classmethod(has_editable_values)

    def _warn(self, sentence):
        self.report({"WARNING"}, sentence)

    @refuses
    def execute(self, context):
        owner = volumes.volume_object(context)
        function, reason = self.chosen(volumes.load_volume(owner, self._warn))
        remark = transfer.write_transfer(owner, function)
        if remark:
            self._warn(remark)
        if reason:
            self.report({"INFO"}, reason)
        return {"FINISHED"}
