"""Which effects a scene calls for, and the scene with all others removed.

Later stages see only that scene.  A disabled effect therefore adds no work, and the picture is bit for bit that of a
scene without it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from ..runtime.steps import Clock
from ..scene import Quality, RleSplatError, Scene
from .camera_clip import CLIPPING
from .clips import CLIP_OBJECTS
from .glass import GLASS
from .gradient_opacity import GRADIENT_OPACITY
from .kind import Kind
from .lens import DEPTH_OF_FIELD
from .lighting_kinds import HEADLIGHT, LIGHTS, SHADING, SPECULAR
from .mesh_occlusion import MESH_OCCLUSION
from .mist import MIST
from .mixing import CHANNELS, LABELS
from .motion import MOTION_BLUR
from .ray_mode import MODE
from .shadow_kinds import AMBIENT_OCCLUSION, INDIRECT_LIGHT, SHADOWS, WORLD

# Name of an effect -> its kind, in dependency order: each is evaluated on the scene with the disabled effects before it
# removed.
EFFECTS: dict[str, Kind] = {
    "mode": MODE,
    "gradient opacity": GRADIENT_OPACITY,
    "shading": SHADING,
    "lights": LIGHTS,
    "headlight": HEADLIGHT,
    "specular": SPECULAR,
    "world light": WORLD,
    "shadows": SHADOWS,
    "ambient occlusion": AMBIENT_OCCLUSION,
    "mesh occlusion": MESH_OCCLUSION,
    "glass": GLASS,
    "clipping": CLIPPING,
    "depth of field": DEPTH_OF_FIELD,
    "motion blur": MOTION_BLUR,
    "clip objects": CLIP_OBJECTS,
    "labels": LABELS,
    "channels": CHANNELS,
    "indirect light": INDIRECT_LIGHT,
    "mist": MIST,
}


class Effect(NamedTuple):
    """The state of an effect in a scene.

    Attributes
    ----------
    reason : str
        Why, as words behind "on" or "off".
    by_hand : bool or None
        The state that the scene's overrides force; None where the scene decides.
    tried : bool
        Whether a stage has worked on it before it was found to change nothing.
    """

    name: str
    on: bool
    reason: str
    by_hand: bool | None = None
    tried: bool = False


@dataclass(frozen=True)
class EffectSet:
    """The state of every effect in one scene, in the order of EFFECTS."""

    effects: tuple[Effect, ...]

    def __iter__(self):
        return iter(self.effects)

    def __getitem__(self, name: str) -> Effect:
        return next(effect for effect in self.effects if effect.name == name)

    @property
    def on(self) -> tuple[str, ...]:
        """Names of those that are on."""
        return tuple(effect.name for effect in self.effects if effect.on)

    def turn_off(self, name: str, reason: str) -> EffectSet:
        """The same set with an effect off that a stage has found to change nothing."""
        found = self[name]._replace(on=False, reason=reason, tried=True)
        return EffectSet(tuple(found if effect.name == name else effect for effect in self.effects))

    def report(self, clock: Clock) -> list[dict]:
        """Rows for the report.

        Returns
        -------
        list of dict
            With name, on, reason and ms, the milliseconds of the effect's own work: 0 where it is off; None for an
            effect within another's work, which has the time of both.
        """
        return [
            {"name": effect.name, "on": effect.on, "reason": effect.reason, "ms": _milliseconds(effect, clock)}
            for effect in self.effects
        ]


def _milliseconds(effect: Effect, clock: Clock) -> float | None:
    if not (effect.on or effect.tried):
        return 0.0
    stage = EFFECTS[effect.name].stage
    return None if stage is None else clock.stages[stage]


def check_overrides(overrides) -> dict[str, bool]:
    """Check the overrides of a scene; RleSplatError for a name that no effect has.

    Parameters
    ----------
    overrides : mapping of str to bool
        Name of an effect to the state that it is forced to.

    Returns
    -------
    dict of str to bool
    """
    for name in overrides:
        if name not in EFFECTS:
            raise RleSplatError(f"There is no effect called {name!r}; choose {', '.join(EFFECTS)}.")
    return dict(overrides)


def analyze(scene: Scene, quality: Quality) -> EffectSet:
    """Find which effects a scene calls for, and why.

    Parameters
    ----------
    scene : Scene
        ``scene.effects`` overrides what it calls for.

    Raises
    ------
    RleSplatError
        If an override names no effect, or forces one on that the scene lacks something for.
    """
    return analyze_effects(scene, quality)[0]


def analyze_effects(scene: Scene, quality: Quality) -> tuple[EffectSet, Scene]:
    """Find which effects a scene calls for, and remove the others.

    Returns
    -------
    EffectSet
        As ``analyze`` returns it.
    Scene
        The scene with the effects that are off removed, and those that are on by hand added.
    """
    overrides, left, found = check_overrides(scene.effects), scene, []
    for name, by_hand in overrides.items():  # off for every other effect, too
        left = EFFECTS[name].without(left) if by_hand is False else left
    for name, kind in EFFECTS.items():
        by_hand = overrides.get(name)
        if by_hand is False:
            effect = Effect(name, False, "by hand", False)
        else:
            left = left if by_hand is None or kind.with_default is None else kind.with_default(left)
            on, reason = kind.called_for(left, quality)
            reason = reason if on else scene.reasons_off.get(name, reason)
            if by_hand and not on and not kind.may_be_idle:
                raise RleSplatError(
                    f"The effect {name} is turned on by hand, but {reason}; leave it automatic, or add what it "
                    "needs to the scene."
                )
            effect = Effect(name, on or bool(by_hand), f"by hand: {reason}" if by_hand else reason, by_hand)
        if not effect.on and (by_hand is False or not kind.may_be_idle):
            left = kind.without(left)
        found.append(effect)
    return EffectSet(tuple(found)), left
