"""How an operator says no, and which volume it works on."""

from ..bridge import volumes

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


def has_own_transfer(cls, context) -> bool:
    """For ``poll``: whether the volume has a transfer function that may be edited."""
    if not has_volume(cls, context):
        return False
    tree = volumes.volume_object(context).rle_splat.transfer
    if tree is None:
        cls.poll_message_set("The volume has no transfer function; apply a preset")
        return False
    if not tree.is_editable:
        cls.poll_message_set("The transfer function is linked from another file; make it local first")
        return False
    return True
