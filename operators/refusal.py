"""How an operator says no, and which volume it works on."""

from ..bridge import linked, transfer, volumes

NO_VOLUME = "Import a volume first: File > Import > Volume (RLE Splat)"
WHICH_VOLUME = "Select one of the scene's volumes"


def refuse(operator, problem) -> set:
    """Show the sentence of a RleSplatError as the operator's error, changing nothing."""
    operator.report({"ERROR"}, str(problem))
    return {"CANCELLED"}


def has_volume(cls, context) -> bool:
    """For ``poll``: whether it is clear which volume is meant; the button's tooltip says why not."""
    if volumes.volume_object(context) is not None:
        return True
    cls.poll_message_set(WHICH_VOLUME if volumes.volume_objects(context.scene) else NO_VOLUME)
    return False


def has_editable_volume(cls, context) -> bool:
    """For ``poll``: whether it is clear which volume is meant, and edits of it are kept in the .blend."""
    return has_volume(cls, context) and _is_no_problem(cls, linked.why_not_editable(volumes.volume_object(context)))


def has_editable_transfer(cls, context) -> bool:
    """For ``poll``: whether the volume has a transfer function, and edits of the volume are kept in the .blend."""
    return has_editable_volume(cls, context) and _is_no_problem(
        cls, transfer.why_unusable(volumes.volume_object(context)))


def _is_no_problem(cls, problem: str) -> bool:
    if problem:
        cls.poll_message_set(problem)
    return not problem
