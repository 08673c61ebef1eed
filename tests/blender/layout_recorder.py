"""A layout for draw functions where there is no window: it knows what this Blender's UILayout can do.

Functions, their arguments and types, and icons are those that the running Blender's RNA lists; the properties,
operators, menus and panels that are named must exist.  What a window would refuse, or complain of on the console, is
an AssertionError here.
"""

import inspect
from numbers import Integral, Real

import bpy

LAYOUT = bpy.types.UILayout.bl_rna

# The argument that names a property -> the one that holds what it is a property of.
DATA_OF = {
    "property": "data", "search_property": "search_data", "propname": "dataptr", "active_propname": "active_dataptr",
    "property_highlight": "data_highlight", "used_layers_property": "used_layers_data", "type_property": "data",
}  # fmt: skip
CLASSES = {"menu": bpy.types.Menu, "panel": bpy.types.Panel, "listtype_name": bpy.types.UIList}
OPERATORS = ("operator", "new", "open", "unlink")  # arguments that name one
STRUCTS = {"template_curve_mapping": "CurveMapping", "template_color_ramp": "ColorRamp"}
KINDS = {"BOOLEAN": (bool, Integral), "INT": Integral, "FLOAT": Real, "STRING": str, "ENUM": str}

# Of an entry in the log: the first of these arguments.
MAIN = ("property", "operator", "menu", "panel", "text", "icon_value")


def operator_properties(name: str):
    """An operator's properties as the running Blender declares them; None where there is no such operator."""
    return bpy.context.window_manager.operator_properties_last(name)


class Recorder:
    """A layout whose log gets (function, main argument), then ("control", (data, name)) for a property, ("text", ...),
    ("icon", ...) and ("value", ...) where they are given; and (name, value) where an attribute of the layout is set."""

    def __init__(self, log):
        object.__setattr__(self, "log", log)

    def __setattr__(self, name, value):
        entry = LAYOUT.properties.get(name)
        assert entry is not None and not entry.is_readonly, f"a layout has no attribute {name} that can be set"
        _check(entry, value, f"layout.{name}")
        self.log.append((name, value))

    def __getattr__(self, name):
        function = LAYOUT.functions.get(name)
        if function is None:
            raise AttributeError(f"a layout has no {name} in Blender {bpy.app.version_string}")
        if not function.use_self:
            return getattr(bpy.types.UILayout, name)
        return lambda *given, **named: self._call(function, given, named)

    def _call(self, function, given, named):
        where = f"layout.{function.identifier}"
        parameters = {entry.identifier: entry for entry in function.parameters if not entry.is_output}
        assert len(given) <= len(parameters), f"{where} takes {len(parameters)} arguments, and {len(given)} were given"
        arguments = dict(zip(parameters, given))
        for name, value in named.items():
            assert name in parameters, f"{where} has no argument {name}"
            assert name not in arguments, f"{where} got two values for {name}"
            arguments[name] = value
        for name, entry in parameters.items():
            assert name in arguments or not entry.is_required, f"{where} needs the argument {name}"
            if name in arguments:
                _check(entry, arguments[name], f"{where}, argument {name}")
        _check_names(function.identifier, arguments)
        main = next((arguments[name] for name in MAIN if name in arguments), None)
        self.log.append((function.identifier, main))
        if "data" in arguments and "property" in arguments:
            self.log.append(("control", (_struct(arguments["data"]), arguments["property"])))
        self.log.extend((name, arguments[name]) for name in ("text", "icon", "value") if arguments.get(name))
        made = [self._output(entry, arguments) for entry in function.parameters if entry.is_output]
        return made[0] if len(made) == 1 else tuple(made) or None

    def _output(self, entry, arguments):
        return OperatorValues(arguments["operator"]) if entry.identifier == "properties" else Recorder(self.log)


def _check(entry, value, where: str) -> None:
    """Whether Blender takes the value for a property or an argument."""
    if entry.type == "POINTER":
        assert value is not None or not entry.is_never_none, f"{where} is None"
        named = entry.fixed_type.identifier
        kind = bpy.types.bpy_struct if named == "AnyType" else getattr(bpy.types, named)
        fits = value is None or isinstance(_struct(value), kind)
        assert fits, f"{where} is a {type(value).__name__} and no {kind.__name__}"
    elif entry.type == "ENUM":
        names = {item.identifier for item in entry.enum_items}
        values = value if entry.is_enum_flag else {value}
        assert values <= names, f"{where} is {value!r}, which Blender {bpy.app.version_string} does not know"
    elif value is not None or entry.type != "STRING" or entry.is_never_none:
        assert isinstance(value, KINDS[entry.type]), f"{where} is {value!r} and no {entry.type}"


def _check_names(function: str, arguments: dict) -> None:
    """Whether what the arguments name exists."""
    where = f"layout.{function}"
    for name in OPERATORS:
        if arguments.get(name):
            assert operator_properties(arguments[name]) is not None, f"{where}: no operator {arguments[name]}"
    for name, base in CLASSES.items():
        if name in arguments:
            found = getattr(bpy.types, arguments[name], None)
            assert found is not None and issubclass(found, base), f"{where}: no {name} {arguments[name]}"
    for name, holder in DATA_OF.items():
        if name not in arguments:
            continue
        data = _struct(arguments[holder]) if holder in arguments else operator_properties(arguments["operator"])
        entry = data.bl_rna.properties.get(arguments[name])
        assert entry is not None, f"{where}: {data.bl_rna.identifier} has no property {arguments[name]}"
        if "value" in arguments:
            assert arguments["value"] in entry.enum_items, f"{where}: {arguments[name]} is never {arguments['value']}"
        if function in STRUCTS:
            fits = entry.type == "POINTER" and entry.fixed_type.identifier == STRUCTS[function]
            assert fits and getattr(data, arguments[name]) is not None, f"{where}: {arguments[name]} holds none"


def _struct(value):
    return value.data if isinstance(value, Drawn) else value


class OperatorValues:
    """What ``layout.operator`` returns: only values that the operator declares can be set, as the RNA checks them."""

    def __init__(self, name: str):
        object.__setattr__(self, "name", name)

    def __setattr__(self, name, value):
        properties = operator_properties(self.name)
        assert name in properties.bl_rna.properties, f"the operator {self.name} has no property {name}"
        setattr(properties, name, value)
        properties.property_unset(name)  # it is what the operator's next dialog would start with


class Drawn:
    """Stands in for ``self`` while a class draws: its own functions, a layout that records, and for an operator or for
    preferences their properties, which are in ``data``."""

    def __init__(self, kind, log, data=None):
        self.kind, self.layout, self.data = kind, Recorder(log), data

    def __getattr__(self, name):
        if self.data is not None and name in self.data.bl_rna.properties:
            return getattr(self.data, name)
        found = inspect.getattr_static(self.kind, name)
        return found.__get__(self, self.kind) if hasattr(found, "__get__") else found


def subclasses(base) -> list:
    """Every class registered under one of Blender's."""
    below = [cls for child in base.__subclasses__() for cls in (child, *subclasses(child))]
    return [cls for cls in dict.fromkeys(below) if getattr(cls, "is_registered", False)]


def draw_all(module: str, context) -> list:
    """Call every draw function that an add-on has registered and Blender would call now; returns the log, in which
    ("draws", name of a class) comes first.

    Panels (with their headers), menus, dialogs of operators, the preferences, and what the add-on appended to others.
    """
    log: list = []
    preferences = context.preferences.addons[module].preferences
    for base in (bpy.types.Panel, bpy.types.Menu, bpy.types.Header, bpy.types.Operator, bpy.types.AddonPreferences):
        for cls in subclasses(base):
            if cls.__module__.startswith(module) and shows(cls, context):
                data = preferences if base is bpy.types.AddonPreferences else None
                data = operator_properties(cls.bl_idname) if base is bpy.types.Operator else data
                _draw(cls, log, context, data)
            for function in getattr(getattr(cls, "draw", None), "_draw_funcs", ()):
                if function.__module__.startswith(module):
                    log.append(("draws", function.__name__))
                    function(Drawn(cls, log), context)
    return log


def _draw(cls, log, context, data) -> None:
    for name in ("draw_header", "draw_header_preset", "draw"):
        if inspect.isfunction(getattr(cls, name, None)):
            log.append(("draws", cls.__name__))
            getattr(cls, name)(Drawn(cls, log, data), context)


def shows(cls, context) -> bool:
    """Whether a panel's own poll and its parents' let it be drawn; operators' dialogs are drawn whatever poll says."""
    parent = getattr(cls, "bl_parent_id", "")
    if issubclass(cls, bpy.types.Operator):
        return True
    if parent and not shows(getattr(bpy.types, parent), context):
        return False
    return not hasattr(cls, "poll") or cls.poll(context)
