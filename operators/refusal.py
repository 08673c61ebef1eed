"""What operators share: reporting an error, and ``poll`` checks that say why a button is disabled."""

from ..bridge import linked
from ..bridge.look import transfer
from ..bridge.translations import translate
from ..bridge.volumes import encoded, volumes

NO_VOLUME = "Import a volume first: File > Import > Volume (RLE Splat)"
NO_SEGMENTS = "Read a label file first"
WHICH_VOLUME = "Select one of the volumes in the scene"


def refuse(operator, problem) -> set:
    """Report an error and cancel the operator.

    Parameters
    ----------
    operator : bpy.types.Operator
        The operator that reports.
    problem : RleSplatError or str
        One sentence for the user.

    Returns
    -------
    set of str
        ``{"CANCELLED"}``, the result for ``execute``.
    """
    operator.report({"ERROR"}, translate(str(problem)))
    return {"CANCELLED"}


def has_volume(cls, context) -> bool:
    """For ``poll``: whether one volume is meant; otherwise the button's tooltip says what to select."""
    if volumes.volume_object(context) is not None:
        return True
    cls.poll_message_set(WHICH_VOLUME if volumes.volume_objects(context.scene) else NO_VOLUME)
    return False


def has_editable_volume(cls, context) -> bool:
    """For ``poll``: as ``has_volume``, and edits of the volume are saved in the .blend."""
    return has_volume(cls, context) and _is_no_problem(cls, linked.why_not_editable(volumes.volume_object(context)))


def has_values(cls, context) -> bool:
    """For ``poll``: as ``has_volume``, and the volume has values, not voxels that are encoded already."""
    return has_volume(cls, context) and _is_no_problem(cls, encoded.why_no_values(volumes.volume_object(context)))


def has_editable_values(cls, context) -> bool:
    """For ``poll``: as ``has_editable_volume`` and ``has_values``."""
    return has_editable_volume(cls, context) and has_values(cls, context)


def has_segments(cls, context) -> bool:
    """For ``poll``: as ``has_editable_volume``, and the volume has segments."""
    if not has_editable_volume(cls, context):
        return False
    return _is_no_problem(cls, "" if volumes.volume_object(context).rle_splat.labels else NO_SEGMENTS)


def has_editable_transfer(cls, context) -> bool:
    """For ``poll``: as ``has_editable_values``, and the volume has a transfer function."""
    return has_editable_values(cls, context) and _is_no_problem(
        cls, transfer.why_unusable(volumes.volume_object(context))
    )


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


def _is_no_problem(cls, problem: str) -> bool:
    if problem:
        cls.poll_message_set(problem)
    return not problem
