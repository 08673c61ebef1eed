"""The time of each effect on three scenes: alone, over the effects that it depends on, and all together.

"first" is a picture with an empty stage cache.  "frame" is the next picture after a small turn of the camera, with the
cache.  Each effect is measured in alternation with the base that it is added to; milliseconds and ratios are from those
runs.  "made by a frame" lists the stages that run again after the camera's turn.  A disabled effect must take no time.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from devtools.phantom import SPACING_MM, head_phantom
from rle_splat.classify.presets import preset
from rle_splat.classify.transfer_function import GradientOpacity, Shade
from rle_splat.effects.analyze import EFFECTS, analyze_effects
from rle_splat.pipeline.render import render
from rle_splat.pipeline.stage_cache import StageCache
from rle_splat.scene import DEFAULT_CLASSIFICATION, Channel, Clip, Labels, Light, Mist, Pose, Quality, Scene
from rle_splat.view.turntable import turntable
from rle_splat.volume.volume import Volume

from .effects_page import write_page
from .frames import time_by_processor
from .lamps import shining
from .run import Run, make_parser
from .scenes import scenes as volumes_of
from .scenes import shells, smoke

AZIMUTH, ELEVATION, STEP = 35.0, 20.0, 0.5  # degrees; STEP: turn of the camera from frame to frame
REPEATS = 5
PLAIN, LIT, SMOKE = SCENES = "plain CT", "lit CT", "smoke"
MATT, SHINY = Shade(0.2, 0.8, 0.0, 20.0), 0.4
SUN_STRENGTH, LAMP_STRENGTH = 3.0, 20.0  # W/m^2; W per squared half diagonal of the volume
FRAME_TARGET, LIGHT_TARGET = 250.0, 150.0  # milliseconds: the lit CT's frame at 512 x 512; a light pass on 256^3


# --- the effects --------------------------------------------------------------------------------------------------


def _box(scene: Scene) -> tuple[np.ndarray, float]:
    """Center of the volume's box and half its diagonal, in world units."""
    ends = np.array(scene.volume.shape_xyz) - 1.0
    low, high = ((scene.index_to_world @ np.append(part * ends, 1.0))[:3] for part in (0.0, 1.0))
    return 0.5 * (low + high), 0.5 * float(np.linalg.norm(high - low))


def _lights(scene: Scene) -> tuple[Light, ...]:
    """A sun over the camera's shoulder and a lamp from the side."""
    middle, reach = _box(scene)
    lamp = shining((-1.0, 0.2, -0.4))
    lamp[:3, 3] = middle - 1.6 * reach * np.array((-1.0, 0.2, -0.4))
    return (
        Light("SUN", energy=SUN_STRENGTH, matrix_world=shining((0.6, 0.9, -0.7))),
        Light("POINT", color=(1.0, 0.8, 0.6), energy=LAMP_STRENGTH * reach**2, matrix_world=lamp),
    )


def _with_shade(scene: Scene, **more) -> Scene:
    function = scene.transfer_function
    shade = replace(function.shade or MATT, **more)
    return replace(scene, transfer_function=replace(function, shade=shade), headlight=not scene.lights)


def _behind_glass(scene: Scene) -> Scene:
    panes = _implant(scene)
    return replace(scene, panes=panes, pane_shares=np.full((len(panes), 4), 0.9))


def _implant(scene: Scene) -> np.ndarray:
    """(n, 3, 3) triangles of a curved plate around the volume's center, 16 x 16 squares."""
    middle, reach = _box(scene)
    across, along = np.meshgrid(np.linspace(-0.9, 0.9, 17), np.linspace(-0.3, 0.3, 17))
    corners = middle + 0.55 * reach * np.stack((np.sin(across), -np.cos(across), along), axis=-1)
    one, two, three, four = corners[:-1, :-1], corners[:-1, 1:], corners[1:, 1:], corners[1:, :-1]
    return np.concatenate([np.stack(t, axis=2).reshape(-1, 3, 3) for t in ((one, two, three), (one, three, four))])


def _clip_box(scene: Scene) -> tuple[Clip, ...]:
    middle, reach = _box(scene)
    matrix = np.diag((0.3 * reach,) * 3 + (1.0,))
    matrix[:3, 3] = middle + reach * np.array((0.2, -0.3, 0.2))
    return (Clip("box", matrix, "outside"),)


def _clip_plane(scene: Scene) -> tuple[Clip, ...]:
    """A vertical plane along the view that halves the volume."""
    matrix = shining((0.82, 0.57, 0.0))
    matrix[:3, 3] = _box(scene)[0]
    return (Clip("plane", matrix),)


def _distance(scene: Scene) -> float:
    """Planar distance from the camera to the center of the volume."""
    middle, _ = _box(scene)
    return float(-(np.linalg.inv(scene.camera.matrix_world) @ np.append(middle, 1.0))[2])


def _seen(scene: Scene, **more) -> Scene:
    return replace(scene, camera=replace(scene.camera, **more))


def _moving(scene: Scene) -> Scene:
    """The scene with the volume moving by 1/50 of its half diagonal while the shutter is open."""
    poses = []
    for part in (-0.5, 0.5):
        slid = np.array(scene.volume_matrix)
        slid[0, 3] += part * 0.02 * _box(scene)[1]
        poses.append(Pose(scene.camera.matrix_world, slid))
    return replace(scene, motion=tuple(poses))


def _surfaces_only(scene: Scene) -> Scene:
    """The scene with gradient opacity, full at 1/8 of the function's range per voxel."""
    function = scene.transfer_function
    steep = (function.span[1] - function.span[0]) / (8.0 * float(min(scene.volume.spacing)))
    gradual = replace(function, gradient_opacity=GradientOpacity(0.0, steep))
    return replace(scene, transfer_function=gradual)


def _misty(scene: Scene) -> Scene:
    """The scene with mist that begins at the front of the volume and is opaque behind it."""
    reach = _box(scene)[1]
    return replace(scene, mist=Mist(start=max(_distance(scene) - reach, 0.0), depth=2.0 * reach))


@lru_cache(1)
def _halves(volume: Volume) -> Volume:
    """A label map: 1 in the half with low x, 0 in the other."""
    labels = np.zeros(volume.voxels.shape, np.uint8)
    labels[:, :, : labels.shape[2] // 2] = 1
    return Volume(labels, volume.affine, unit=volume.unit)


def _labeled(scene: Scene) -> Scene:
    """The scene with one half in other colors."""
    function = scene.transfer_function
    other = replace(function, color=tuple((value, blue, green, red) for value, red, green, blue in function.color))
    return replace(scene, labels=Labels(_halves(scene.volume), {1: other}))


@lru_cache(1)
def _mirrored(volume: Volume) -> Volume:
    return replace(volume, voxels=np.ascontiguousarray(volume.voxels[:, :, ::-1]))


def _doubled(scene: Scene) -> Scene:
    """The scene with the volume's mirror image as a channel."""
    return replace(scene, channels=(Channel(_mirrored(scene.volume), scene.transfer_function),))


@dataclass(frozen=True)
class Price:
    """A row of the measurement."""

    effect: str
    over: str | None  # the price that it is added to; None for the scene's base
    give: Callable  # give(scene) is the scene with the effect


# Label -> Price.  Effects without a price are listed at the end of the report.
PRICES = {
    "shading": Price("shading", None, _with_shade),
    "specular": Price("specular", "shading", lambda scene: _with_shade(scene, specular=SHINY)),
    "lights": Price("lights", "shading", lambda scene: replace(scene, lights=_lights(scene), headlight=False)),
    "shadows": Price("shadows", "lights", lambda scene: replace(scene, volume_shadows=True)),
    "world light": Price("world light", "lights", lambda scene: replace(scene, world=(0.2, 0.25, 0.3))),
    "indirect light": Price("indirect light", "shadows", lambda scene: replace(scene, indirect_light=1.0)),
    "ambient occlusion": Price("ambient occlusion", "lights", lambda scene: replace(scene, ambient_occlusion=1.0)),
    "mesh occlusion": Price("mesh occlusion", None, lambda scene: replace(scene, triangles=_implant(scene))),
    "glass": Price("glass", None, _behind_glass),
    "clipping": Price("clipping", None, lambda scene: _seen(scene, clip_start=0.95 * _distance(scene))),
    "clip objects": Price("clip objects", None, lambda scene: replace(scene, clips=_clip_box(scene))),
    "clip plane": Price("clip objects", None, lambda scene: replace(scene, clips=_clip_plane(scene))),
    "depth of field": Price(
        "depth of field", None,
        lambda scene: _seen(scene, aperture_radius=0.01 * _box(scene)[1], focus_distance=_distance(scene)),
    ),
    "motion blur": Price("motion blur", None, _moving),
    "gradient opacity": Price("gradient opacity", None, _surfaces_only),
    "mist": Price("mist", None, _misty),
    "labels": Price("labels", None, _labeled),
    "channels": Price("channels", None, _doubled),
    **{
        f"mode {name}": Price("mode", None, lambda scene, name=name: replace(scene, mode=name))
        for name in ("xray", "mip", "minip", "average")
    },
}  # fmt: skip


MANY_PICTURES = ("depth of field", "motion blur")  # the mean of several pictures: they multiply the time of the others
ALL, ALL_PICTURES = "all together", "all, with lens and shutter"


def given(scene: Scene, label: str) -> Scene:
    """The scene with the effect of a label and those that it depends on."""
    price = PRICES[label]
    return price.give(scene if price.over is None else given(scene, price.over))


# --- the scenes ---------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Setting:
    """A volume with a transfer function, seen in perspective."""

    name: str
    volume: Volume
    function: object
    lit: bool  # whether the base has two lights without highlights
    priced: tuple[str, ...]  # labels of PRICES: each alone and, but modes, all together; without and with MANY_PICTURES

    def at(self, azimuth: float, size: int) -> Scene:
        camera, matrix = turntable(self.volume, azimuth, ELEVATION, perspective=True)
        function = replace(self.function, shade=None)
        scene = Scene(self.volume, function, camera, size, size, matrix, headlight=False)
        return given(scene, "lights") if self.lit else scene


def _ct_head():
    """(volume, transfer function) of the scan, or of a synthetic head if the scan is missing."""
    found = next(volumes_of(["CT head"]), None)
    if found is not None:
        return found[1:]
    affine = np.diag((*(SPACING_MM,) * 3, 1.0))
    return Volume(head_phantom(), affine, unit="mm", value_unit="HU", name="CT head"), preset("ct-bone")


def settings() -> tuple[Setting, ...]:
    on_lights = (
        "specular", "shadows", "indirect light", "world light", "ambient occlusion", "mesh occlusion", "glass",
        "clipping", "clip objects", "clip plane", "depth of field",
    )  # fmt: skip
    on_plain = (
        "shading", "specular", "clipping", "clip objects", "clip plane", "gradient opacity", "labels", "channels"
    )  # fmt: skip
    cloud = smoke()
    head, bone = _ct_head()
    return (
        Setting(PLAIN, head, bone, False, tuple(
            n for n in PRICES if n in on_plain or n.startswith("mode ")
        )),
        Setting(LIT, head, bone, True, tuple(n for n in PRICES if n in on_lights)),
        Setting(SMOKE, cloud, preset("smoke"), False, tuple(n for n in PRICES if not n.startswith("mode "))),
    )  # fmt: skip


# --- measuring ----------------------------------------------------------------------------------------------------


@dataclass
class _Runs:
    """The fastest runs of one variant of a scene."""

    make: Callable  # azimuth -> Scene
    quality: Quality
    first: float = np.inf
    frame: float = np.inf
    report: dict | None = None
    made: frozenset = frozenset()

    def __post_init__(self):
        self.cache = StageCache()

    def begin(self) -> None:
        self.cache.clear()
        self._taken(render(self.make(AZIMUTH), self.quality, cache=self.cache).report, "first")

    def turn(self, number: int) -> None:
        before = dict(self.cache.made)
        report = render(self.make(AZIMUTH + STEP * number), self.quality, cache=self.cache).report
        self.made |= {stage for stage, count in self.cache.made.items() if count > before.get(stage, 0)}
        if self._taken(report, "frame"):
            self.report = report

    def _taken(self, report: dict, what: str) -> bool:
        spent = report["stages_ms"]["total"]
        is_least = spent < getattr(self, what)
        if is_least:
            setattr(self, what, spent)
            if what == "first":
                self.first_report = report
        return is_least


def compare(base: Callable, other: Callable, quality: Quality, repeats: int) -> tuple[_Runs, _Runs]:
    """Measure two variants, functions of an azimuth, in alternation."""
    both = _Runs(base, quality), _Runs(other, quality)
    for runs in both:
        render(runs.make(AZIMUTH), quality)  # compiles and loads kernels
    for _ in range(repeats):
        for runs in both:
            runs.begin()
    for number in range(1, repeats + 1):
        for runs in both:
            runs.turn(number)
    return both


def measure(setting: Setting, quality: Quality, size: int, repeats: int, only=None) -> list[dict]:
    """JSON-ready rows: each effect of a setting alone, all together, and all forced off; or some effects alone."""

    def base(azimuth):
        return setting.at(azimuth, size)

    def priced(label):
        return lambda azimuth: given(base(azimuth), label)

    def all_of(labels):
        def make(azimuth):
            scene = base(azimuth)
            for label in labels:
                scene = given(scene, label)
            return scene

        return make

    def forced_off(azimuth):
        return replace(all_of(together)(azimuth), effects={PRICES[label].effect: False for label in together})

    def never_heard_of(azimuth):
        scene = forced_off(azimuth)
        return replace(analyze_effects(scene, quality)[1], effects={})

    together = [label for label in setting.priced if PRICES[label].effect != "mode"]
    rows = []
    for label in setting.priced:
        if only and label not in only:
            continue
        over = None if setting.lit else PRICES[label].over  # a lit scene has all effects that others depend on
        below = base if over is None else priced(over)
        rows.append(_row(setting, label, over or "base", *compare(below, priced(label), quality, repeats)))
    if only:
        return rows
    of_one = [label for label in together if label not in MANY_PICTURES]
    rows.append(_row(setting, ALL, "base", *compare(base, all_of(of_one), quality, repeats)))
    if len(of_one) < len(together):
        rows.append(_row(setting, ALL_PICTURES, "base", *compare(base, all_of(together), quality, repeats)))
    rows.append(_row(setting, "all off by hand", "never", *compare(never_heard_of, forced_off, quality, repeats)))
    return rows


def _row(setting: Setting, label: str, over: str, below: _Runs, runs: _Runs) -> dict:
    listed = {effect["name"]: effect for effect in runs.first_report["effects"]}
    in_frame = {effect["name"]: effect for effect in runs.report["effects"]}
    return {
        "scene": setting.name, "effect": label, "of": PRICES[label].effect if label in PRICES else None, "over": over,
        "first_ms": runs.first, "frame_ms": runs.frame, "over_first_ms": below.first, "over_frame_ms": below.frame,
        "first_ratio": runs.first / below.first, "frame_ratio": runs.frame / below.frame,
        "on": [name for name, effect in listed.items() if effect["on"]],
        "own_first_ms": {name: effect["ms"] for name, effect in listed.items() if effect["on"]},
        "own_frame_ms": {name: effect["ms"] for name, effect in in_frame.items() if effect["on"]},
        "off_ms": sum(effect["ms"] for effect in (*listed.values(), *in_frame.values()) if not effect["on"]),
        "made_by_a_frame": sorted(runs.made),
        "more_kernels": sorted(set(runs.first_report["kernels"]) - set(below.first_report["kernels"])),
        "fewer_kernels": sorted(set(below.first_report["kernels"]) - set(runs.first_report["kernels"])),
    }  # fmt: skip


def light_pass(quality: Quality, side: int, size: int, repeats: int) -> dict:
    """Milliseconds of the shadows of one and of two lights on a volume of ``side``^3 voxels."""
    setting = Setting("shells", *shells(side), False, ())
    spent = {}
    for lights in (1, 2):

        def cast(azimuth, lights=lights):
            scene = given(setting.at(azimuth, size), "shadows")
            return replace(scene, lights=scene.lights[:lights])

        runs, _ = compare(cast, cast, quality, repeats)
        listed = next(effect for effect in runs.first_report["effects"] if effect["name"] == "shadows")
        spent[lights] = listed["ms"]
        redone = "shadows" in runs.made
    return {
        "side": side, "one_light_ms": spent[1], "two_lights_ms": spent[2], "a_light_ms": max(spent[1], spent[2] / 2.0),
        "target_ms": LIGHT_TARGET, "made_again_by_a_turn_of_the_camera": redone,
    }  # fmt: skip


# --- the report ---------------------------------------------------------------------------------------------------


def header() -> str:
    return (
        f"{'scene':<10}{'effect':<27}{'over':<10}{'first ms':>10}{'x':>7}{'frame ms':>10}{'x':>7}"
        f"{'own, first':>12}{'off ms':>8}  made by a frame"
    )


def line(row: dict) -> str:
    """One line of the table."""
    own = row["own_first_ms"].get(row["of"])
    return (
        f"{row['scene']:<10}{row['effect']:<27}{row['over']:<10}{row['first_ms']:10.1f}{row['first_ratio']:7.2f}"
        f"{row['frame_ms']:10.1f}{row['frame_ratio']:7.2f}{'-' if own is None else f'{own:.1f}':>12}"
        f"{row['off_ms']:8.1f}  {', '.join(row['made_by_a_frame']) or '-'}"
    )


def main(arguments) -> int:
    parser = make_parser(
        "dev.py bench effects", __doc__, scene={"choices": SCENES, "help": "instead of all three"}, size=512,
        side={"help": "voxels along an edge of the light pass's volume"}, repeats=REPEATS, threads=0,
        quality={"nargs": None, "default": "standard"}, classification=DEFAULT_CLASSIFICATION,
    )  # fmt: skip
    parser.add_argument("--effect", nargs="*", choices=list(PRICES), help="only these rows")
    parser.add_argument("--processor", action="store_true", help="processor time of one thread, on a busy machine")
    parser.add_argument("--docs", action="store_true", help="write the tables into the page effects.md")
    options = parser.parse_args(arguments)
    if options.docs and options.effect:
        parser.error("--docs takes the rows of all effects; leave --effect out")
    if options.processor:
        options.threads = 1
        time_by_processor()
    quality = Quality.preset(options.quality, classification=options.classification, threads=options.threads)
    run = Run("effects", arguments, options.threads, key=("scene", "effect"), time="frame_ms")
    print(
        f"{options.size} x {options.size}, {options.quality}, classification "
        f"{options.classification}; the least of {options.repeats} runs\n\n{header()}"
    )
    for setting in settings():
        if options.scene and setting.name not in options.scene:
            continue
        for row in measure(setting, quality, options.size, options.repeats, options.effect):
            run.rows.append(row)
            print(line(row), flush=True)
    unpriced = [name for name in EFFECTS if name not in {price.effect for price in PRICES.values()} | {"headlight"}]
    print(f"\nNot priced: {', '.join(unpriced) or 'none'}.")
    lit = next((row for row in run.rows if (row["scene"], row["effect"]) == (LIT, ALL)), None)
    if lit is not None:
        print(
            f"Lit CT, all effects: {lit['frame_ms']:.0f} ms a frame at {options.size}; the target is {FRAME_TARGET:g} "
            f"at 512. A turn of the camera makes anew: {', '.join(lit['made_by_a_frame']) or 'nothing'}."
        )
    passed = None
    if not options.effect and (not options.scene or LIT in options.scene):
        passed = light_pass(quality, options.side, options.size, options.repeats)
        print(
            f"Light pass on {options.side}^3: {passed['a_light_ms']:.0f} ms a light; the target is {LIGHT_TARGET:g} on "
            f"256^3. Made again by a turn of the camera: {passed['made_again_by_a_turn_of_the_camera']}."
        )
    found = {"size": options.size, "quality": options.quality, "classification": options.classification,
             "not_priced": unpriced, "light_pass": passed, "processor_time": options.processor}  # fmt: skip
    run.keep(**found)
    if options.docs:
        write_page({"circumstances": run.where, "rows": run.rows, **found})
    return 0
