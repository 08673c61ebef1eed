"""Checkboxes for numbers of which one value means something else, so that panels show a word instead of that number."""


def switch(name: str, special: float, other: float, *, when_special: bool = True) -> dict:
    """Keyword arguments ``get`` and ``set`` of a BoolProperty that says whether a number has its special value.

    Parameters
    ----------
    name : str
        The number, a property of the same group.
    special : float
        The special value, such as 0 for "automatic".
    other : float
        What the number becomes when it ceases to be special.
    when_special : bool
        Value of the checkbox while the number is special.
    """

    def get(group) -> bool:
        return (getattr(group, name) == special) == when_special

    def put(group, on: bool) -> None:
        if on != get(group):
            setattr(group, name, special if on == when_special else other)

    return {"get": get, "set": put}


def draw_number(layout, data, name: str, switch: str, text: str = "", unit: str | None = None) -> None:
    """Draw a number that a checkbox makes automatic: the checkbox alone, or both.

    Parameters
    ----------
    name, switch : str
        The number, and the checkbox of ``switch``, whose label says what it makes of the number.
    text : str
        In place of the number's name, where that would be cut off.
    unit : str, optional
        Of the number, in brackets. It stands below the name, since both would be too long for a narrow sidebar.
    """
    column = layout.column(align=True, heading=text or data.rna_type.properties[name].name)
    column.prop(data, switch)
    if not getattr(data, switch):
        column.prop(data, name, text=unit or " ", translate=False)
