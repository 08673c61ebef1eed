"""Plans that an accuracy sweep measures: the qualities of the package and some between them."""

from dataclasses import asdict, replace

from ...scene import CLASSIFICATIONS, QUALITY_PRESETS, Classification, Quality, RleSplatError

MACHINE = ("threads", "name", "held")  # fields in which two equal plans may differ
# Depth rules and sheet densities of plans between the qualities; a classification leaves out those that it lacks.
BETWEEN = (
    ("slice", 1.0), ("slice", 1.5), ("gauss2", 1.5), ("midpoint-2", 2.0), ("midpoint-4", 2.0), ("midpoint-4", 3.0),
    ("preintegrated", 2.0), ("preintegrated-2", 1.5), ("preintegrated-4", 3.0),
)  # fmt: skip


def sensible_plans(base: Quality) -> list[Quality]:
    """The plans that are worth measuring on any scene.

    These are the paper's own plan, the qualities of the other classification, the qualities of ``base``'s
    classification, and some plans between those.

    Parameters
    ----------
    base : Quality
        Its threads and, where there is a choice, record are those of all plans.

    Returns
    -------
    list of Quality
        Each with a name of its own.  Plans with the same tables follow each other; the last plan is the most accurate.
    """
    plans = [Quality.paper(record=base.record, threads=base.threads)]
    for classification in CLASSIFICATIONS:
        if classification != base.classification:
            plans += _qualities(base, classification)
    mine = _qualities(base, base.classification)
    known = {(plan.depth_rule, plan.sheet_density) for plan in mine}
    for rule, density in BETWEEN:
        fields = dict(depth_rule=rule, sheet_density=density, termination=1 / 4096, exact_light=False)
        plan = possible(mine[-1], name=_named(base.classification, f"{rule} {density:.1f}"), **fields)
        if plan is not None and (rule, density) not in known:
            plans.append(plan)
    return plans + mine


def possible(base: Quality, **fields) -> Quality | None:
    """``base`` with these fields changed; None where they do not go together."""
    try:
        return replace(base, **fields)
    except RleSplatError:
        return None


def _qualities(base: Quality, classification: Classification) -> list[Quality]:
    """The quality presets of a classification; the last one is the most accurate."""
    fields = dict(threads=base.threads)
    if classification != "post":  # which stores the volume's own values
        fields["record"] = base.record
    return [
        replace(Quality.preset(name, classification=classification, **fields), name=_named(classification, name))
        for name in QUALITY_PRESETS
    ]


def _named(classification: str, name: str) -> str:
    """``name``, after the classification where that is not the default."""
    return name if classification == Quality.preset("standard").classification else f"{classification} {name}"


def same_plan(one: Quality, other: Quality) -> bool:
    """Whether two plans are equal in every field but those of MACHINE."""
    shared = {name: getattr(other, name) for name in MACHINE}
    return replace(one, **shared) == other


def knobs_of(plan: Quality) -> dict:
    """A plan as JSON: every field but those of MACHINE."""
    return {name: value for name, value in asdict(plan).items() if name not in MACHINE}


def with_plan(plans, chosen: Quality) -> tuple[list[Quality], str]:
    """Add the plan ``chosen`` where it is not among the plans; returns all plans, and its name among them."""
    for plan in plans:
        if same_plan(plan, chosen):
            return list(plans), plan.name
    name = chosen.name
    while any(plan.name == name for plan in plans):
        name = f"your {name}"
    return [*plans, replace(chosen, name=name)], name
