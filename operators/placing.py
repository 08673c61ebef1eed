"""What operators share that add an object to the scene: it becomes the only selected and the active one."""


def make_active(operator, context, one, does: str) -> None:
    """Select a new object and no other; warn if the viewport does not show it.

    Parameters
    ----------
    does : str
        What it does although it is not visible, such as "cuts the volume".
    """
    select_alone(context, one)
    if not one.visible_get():
        operator.report({"WARNING"}, f"{one.name} {does} but is not visible, because its collection is hidden in the "
                                     "viewport; show the collection in the Outliner to move it.")  # fmt: skip


def select_alone(context, one) -> None:
    """Select an object and no other, and make it the active one; a hidden object stays unselected."""
    for other in context.selected_objects:
        other.select_set(False)
    one.select_set(True)
    context.view_layer.objects.active = one
