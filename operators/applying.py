"""What the operators that replace a volume's transfer function have in common."""

from ..bridge.look import transfer
from ..bridge.volumes import volumes
from ..rle_splat.scene import RleSplatError
from .reading import LoadsFirst
from .refusal import has_editable_values, refuse


class AppliesTransfer(LoadsFirst):
    """Gives the volume the transfer function that ``chosen`` returns for it, and why it was chosen."""

    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        return has_editable_values(cls, context)

    def _warn(self, sentence):
        self.report({"WARNING"}, sentence)

    def execute(self, context):
        owner = volumes.volume_object(context)
        try:
            function, reason = self.chosen(volumes.load_volume(owner, self._warn))
        except RleSplatError as problem:
            return refuse(self, problem)
        remark = transfer.write_transfer(owner, function)
        if remark:
            self._warn(remark)
        if reason:
            self.report({"INFO"}, reason)
        return {"FINISHED"}
