"""What operators share: reporting an error, and ``poll`` checks that say why a button is disabled."""

from functools import wraps

from ..bridge import linked
from ..bridge.look import transfer
from ..bridge.translations import translate
from ..bridge.volumes import encoded, volumes
from ..rle_splat.scene import RleSplatError

NO_VOLUME = "Import a volume first: File > Import > Volume"
WHICH_VOLUME = "Select one of the volumes in the scene"


def refuse(operator, problem) -> set:
    """Report an error and cancel the operator; return ``{"CANCELLED"}``, the result for ``execute``."""
    operator.report({"ERROR"}, translate(str(problem)))
    return {"CANCELLED"}


def refuses(act):
    """Decorate ``execute`` of an operator: an RleSplatError that it raises is reported and cancels the operator."""

    @wraps(act)
    def execute(self, context):
        try:
            return act(self, context)
        except RleSplatError as problem:
            return refuse(self, problem)

    return execute


def needs(cls, condition, otherwise: str) -> bool:
    """For ``poll``: whether a condition holds; the button's tooltip gives a sentence if it does not."""
    if not condition:
        cls.poll_message_set(otherwise)
    return bool(condition)


def has_volume(cls, context) -> bool:
    """For ``poll``: whether one volume is meant; otherwise the button's tooltip says what to select."""
    found = volumes.volume_object(context) is not None
    return found or needs(cls, False, WHICH_VOLUME if volumes.volume_objects(context.scene) else NO_VOLUME)


def has_editable_volume(cls, context) -> bool:
    """For ``poll``: as ``has_volume``, and edits of the volume are saved in the .blend."""
    return has_volume(cls, context) and _has_no(cls, linked.why_not_editable(volumes.volume_object(context)))


def has_values(cls, context) -> bool:
    """For ``poll``: as ``has_volume``, and the volume has values, not voxels that are encoded already."""
    return has_volume(cls, context) and _has_no(cls, encoded.why_no_values(volumes.volume_object(context)))


def has_editable_values(cls, context) -> bool:
    """For ``poll``: as ``has_editable_volume`` and ``has_values``."""
    return has_editable_volume(cls, context) and has_values(cls, context)


def has_segments(cls, context) -> bool:
    """For ``poll``: as ``has_editable_volume``, and the volume has segments."""
    return has_editable_volume(cls, context) and needs(
        cls, volumes.volume_object(context).rle_splat.labels, "Load or make segments first"
    )


def has_editable_transfer(cls, context) -> bool:
    """For ``poll``: as ``has_editable_values``, and the volume has a transfer function."""
    return has_editable_values(cls, context) and _has_no(cls, transfer.why_unusable(volumes.volume_object(context)))


def why_no_editable_transfer(context) -> str:
    """The problem that ``has_editable_transfer`` finds, for an operator without a button to gray out; "" for none.

    Returns
    -------
    str
        A clause without a period.
    """
    return "" if has_editable_transfer(_Noted, context) else _Noted.problem


class _Noted:
    """Stands in for an operator class whose poll message is wanted."""

    problem = ""

    @classmethod
    def poll_message_set(cls, problem: str) -> None:
        cls.problem = problem


def _has_no(cls, problem: str) -> bool:
    return needs(cls, not problem, problem)
