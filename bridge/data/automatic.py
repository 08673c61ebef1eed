"""Checkboxes for numbers of which one value means something else, so that panels show a word instead of that number."""

from ..translations import with_unit


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


def draw_number(layout, data, name: str, switch: str) -> None:
    """Draw a number that a checkbox makes automatic: the checkbox alone, or both.

    Parameters
    ----------
    name, switch : str
        The number, and the checkbox of ``switch``, whose label says what it makes of the number.
    """
    column = layout.column(align=True, heading=data.rna_type.properties[name].name)
    column.prop(data, switch)
    if not getattr(data, switch):
        column.prop(data, name, text=" ", translate=False)


def draw_length(layout, properties, name: str, switch: str, label: str, automatic: float) -> None:
    """Draw a length of a volume that a checkbox makes automatic, below its name and unit, with the number in use.

    Parameters
    ----------
    name, switch : str
        As of ``draw_number``.
    label : str
        The number's name.
    automatic : float
        The length while the checkbox is on.
    """
    column = layout.column(align=True)
    column.use_property_split = False  # name and unit would be cut off
    column.label(text=with_unit(label, properties.length_unit), translate=False)
    row = column.row(align=True)
    row.prop(properties, switch)
    if getattr(properties, switch):
        row.label(text=f"{automatic:.4g}" if automatic else "", translate=False)  # 0 in files of early versions
    else:
        row.prop(properties, name, text="")
