"""What a picture to a tolerance reports: its rounds, the best of them, and sentences for people."""

from dataclasses import dataclass, replace

from ...runtime.figures import figure_text, percent_text
from ...scene import Rendering, truth_of
from .candidates import KEPT_KNOBS, name_of
from .choose import Choice
from .session import PlannerSession
from .single_rays import with_rays

CHOSEN = "The fastest settings that are expected to stay within the tolerance are used."
KEPT = "The settings of the previous frame are kept, as they are expected to stay within the tolerance."
BLURS = (
    "The classification pre (Interpolate: Colors) blurs and widens what the transfer function shows between the values "
    "of neighboring voxels; post (Interpolate: Values) does not."
)
STRICTEST = 0.05  # levels: below this, sheets of 32-bit floats and the eye show no difference


@dataclass(frozen=True, eq=False)
class Round:
    """One picture of a search for a tolerance.

    Attributes
    ----------
    rays : int
        Pixels that single rays traced.
    rays_ms : float
        Milliseconds of these rays.
    probed : dict or None
        The summary of the errors at probe pixels (``probes.error_summary``), None without probes.
    """

    choice: Choice
    rendering: Rendering
    rays: int
    rays_ms: float
    probed: dict | None

    @property
    def measured(self) -> float | None:
        """The largest error at the probe pixels, in levels; None without probes."""
        return self.probed["largest"] if self.probed else None

    @property
    def milliseconds(self) -> float:
        """Of splat, warp and single rays, which every frame takes."""
        return self.frame_ms + self.rays_ms

    @property
    def frame_ms(self) -> float:
        """Milliseconds of splat and warp."""
        stages = self.rendering.report["stages_ms"]
        return stages["splat"] + stages["warp"]

    @property
    def share(self) -> float:
        """The share of the picture's pixels that single rays traced."""
        return self.rays / max(self.rendering.rgba[..., 0].size, 1)

    @property
    def plan(self) -> str:
        """The plan's name for people, with the share of single rays."""
        name = name_of(self.choice.plan)
        return f"{name} + {percent_text(self.share)} by {self.choice.slabs}-slab rays" if self.rays else name

    def report(self) -> dict:
        """JSON-ready."""
        return {
            "plan": self.plan, "predicted": self.choice.errors.total, "measured": self.measured,
            "predicted_ms": self.choice.milliseconds, "ms": self.milliseconds,
        }  # fmt: skip


def with_report(
    session: PlannerSession, tolerance: float, rounds: list[Round], spent: float, left_out: list[str], gave_up: bool,
    earlier: dict | None = None, margin: float = 1.0,
) -> Rendering:  # fmt: skip
    """Take the best round's picture and complete its report.

    Parameters
    ----------
    tolerance : float
        Levels.
    spent : float
        Milliseconds of everything.
    left_out : list of str
        Names of the effects that the picture was asked for with, and is without.
    gave_up : bool
        Whether further rounds were allowed no more.
    earlier : dict, optional
        The plan of the frame before (see ``tolerance.render_within_steps``).
    margin : float
        How many times as much other pixels may err as the probes.
    """
    best = min(rounds, key=lambda one: one.measured if one.measured is not None else 0.0)
    error = _error_report(session, tolerance, rounds, best, spent, margin)
    remarks = [*best.rendering.report["remarks"], *_remarks(session, error, gave_up, margin)]
    if left_out:
        remarks.append(
            f"A picture with a maximum error has no {' and no '.join(left_out)}, because its reference has none; set "
            "Interpolate to Values (classification post), or use a quality without a maximum error."
        )
    report = best.rendering.report
    is_kept = earlier is not None and all(getattr(best.choice.plan, knob) == earlier[knob] for knob in KEPT_KNOBS)
    plan = {**report["plan"], "name": best.plan, "why": KEPT if is_kept else CHOSEN}
    completed = {
        **report, "plan": plan, "error": error, "remarks": remarks,
        "stages_ms": with_rays(report["stages_ms"], best.rays_ms),
        "rays": {name: error["rays"][name] for name in report["rays"]},
    }  # fmt: skip
    return replace(best.rendering, report=completed)


def _error_report(
    session: PlannerSession, tolerance: float, rounds: list[Round], best: Round, spent: float, margin: float
) -> dict:
    """The report's ``error``."""
    choice = best.choice
    least = choice.errors.total if best.measured is None else margin * best.measured
    kept = choice.keeps if best.measured is None else least <= tolerance
    error = {
        "tolerance": tolerance,
        "predicted": choice.errors.total,
        "measured": best.measured,
        "truth": truth_of(session.quality),
        "probes": sum(best.probed[kind]["count"] for kind in ("random", "steep")) if best.probed else 0,
        "kept": bool(kept),
        "floor": None if kept else least,
        "predicted_ms": choice.milliseconds,
        "ms": best.milliseconds,
        "planning_ms": max(spent - best.milliseconds, 0.0),
        "rays": {
            "pixels": best.rays, "share": best.share,
            "slabs": choice.slabs if best.rays else 0, "ms": best.rays_ms,
        },
        "budget": choice.errors.report(),
        "rounds": [one.report() for one in rounds],
        "features": session.features.report(),
    }  # fmt: skip
    if best.probed:
        error |= {name: best.probed[name] for name in ("random", "steep", "share", "confidence")}
        error["statement"] = best.probed["sentence"]
    error["sentence"] = sentence(error)
    return error


def sentence(error: dict) -> str:
    """Prediction and measurement of an ``error`` report for people, in levels.

    For example ``predicted 0.4, measured 0.31 on 1000 sample pixels, 84 ms (planned and measured in 2.1 s)``.
    """
    parts = [f"predicted {figure_text(error['predicted'])}"]
    if error["measured"] is not None:
        parts.append(f"measured {figure_text(error['measured'])} on {error['probes']} sample pixels")
    done = "planned" if error["measured"] is None else "planned and measured"
    return f"{', '.join(parts)}, {error['ms']:.0f} ms ({done} in {error['planning_ms'] / 1e3:.1f} s)"


def _remarks(session: PlannerSession, error: dict, gave_up: bool, margin: float) -> list[str]:
    """Sentences on the classification, and on what was not kept or not measured."""
    remarks, tolerance, triangles = [], error["tolerance"], session.shown.triangles
    if session.quality.classification == "pre":
        remarks.append(BLURS)
    if not error["kept"]:
        times = f"{margin:g} times what was " if margin > 1.0 else ""
        how = f"{times}measured" if error["measured"] is not None else "predicted"
        found = "cannot be reached in this scene; the smallest error is"
        if gave_up:
            found = (
                f"was not reached in {len(error['rounds'])} pictures with ever finer settings; the smallest error is"
            )
        remarks.append(
            f"A maximum error, in 8-bit steps, of {tolerance:g} {found} {figure_text(error['floor'])}, {how} against "
            "the reference."
        )
    elif tolerance < STRICTEST:
        remarks.append(
            f"A maximum error below {STRICTEST:g} in 8-bit steps is finer than a picture of 32-bit numbers can show."
        )
    if error["measured"] is None:
        remarks.append("The error is predicted and was not measured.")
    if triangles is not None and len(triangles) and error["measured"] is not None:
        remarks.append("The error was measured only where no mesh ends a ray or one beside it.")
    return remarks
