"""The F-curves of a datablock's action."""


def curves_of(datablock) -> list:
    """The F-curves of the action that a datablock uses, of its own slot.

    Returns
    -------
    list of bpy.types.FCurve
        Empty without an action.
    """
    data = datablock.animation_data
    if data is None or data.action is None or data.action_slot is None:
        return []
    bags = (strip.channelbag(data.action_slot) for layer in data.action.layers for strip in layer.strips)
    return [curve for bag in bags if bag is not None for curve in bag.fcurves]
