"""Options of shadows, world light, ambient occlusion and indirect light, and the light of `.rle` files."""

from dataclasses import replace

import numpy as np

from ..scene import RleSplatError, Scene
from ..scene.plain import plain
from ..shade.light_recipes import RECIPES, add_lights
from ..view.projection import depth_row
from .appearance import set_smoothness
from .images import read_environment

# Directions that differ by less than this are equal: a .rle file stores them exactly, a camera file may round them.
DIRECTION_TOLERANCE = 1e-6


def add_light_effect_options(parser, with_pass: bool = True) -> None:
    """Add these options; ``with_pass``: the one of the shadow pass too."""
    group = parser.add_argument_group("shadows and ambient light")
    group.add_argument(
        "--light-recipe", choices=RECIPES, metavar="NAME",
        help=f"lights for a kind of scan: {', '.join(RECIPES)}; they are placed for the camera's view, with shadows "
        "and, except for smoke, ambient occlusion",
    )  # fmt: skip
    group.add_argument(
        "--shadows",
        action="store_true",
        help="let --lights cast shadows; not those with casts_shadow false; a headlight casts none",
    )
    group.add_argument(
        "--world", nargs=3, type=float, metavar=("R", "G", "B"),
        help="scene-linear light from all directions, as Blender's world",
    )  # fmt: skip
    group.add_argument(
        "--environment",
        metavar="FILE.exr",
        help="an equirectangular picture of the radiance from all directions, as of Blender's environment texture: row "
        "0 is +Z, the middle +X; it replaces the default headlight",
    )
    group.add_argument(
        "--ambient-occlusion", type=float, metavar="STRENGTH",
        help="darken hollows, 0 (off) to 1; default 0, or that of the recipe",
    )  # fmt: skip
    group.add_argument(
        "--indirect-light", type=float, metavar="AMOUNT",
        help="scattering, 0 (off) to 1; default 0, or that of the recipe; light that casts shadows scatters in the "
        "volume; only with --classification post",
    )  # fmt: skip
    if with_pass:
        group.add_argument(
            "--shadow-pass",
            metavar="FILE",
            help="also write a picture of the share of each pixel's light that shadows and ambient occlusion remove",
        )


def check_light_effects(args) -> None:
    """Refuse options that contradict each other or have no effect, before any file is read."""
    wanted = {
        "light-recipe": args.light_recipe is not None, "shadows": args.shadows, "world": args.world is not None,
        "environment": args.environment is not None, "ambient-occlusion": bool(args.ambient_occlusion),
        "indirect-light": bool(args.indirect_light),
    }  # fmt: skip
    if wanted["world"] and wanted["environment"]:
        raise RleSplatError("--world and --environment are both the light from all directions; give one of the two.")
    if args.light_recipe and args.lights:
        raise RleSplatError("--light-recipe and --lights are both the lights; give one of the two.")
    name = next((name for name, given in wanted.items() if given), None)
    if name is not None and args.no_shading:
        raise RleSplatError(f"--no-shading and --{name} contradict each other; give one of the two.")
    shadow_pass = getattr(args, "shadow_pass", None)
    if shadow_pass is not None and not (args.shadows or args.ambient_occlusion or args.light_recipe):
        raise RleSplatError("--shadow-pass needs shadows; add --shadows or --ambient-occlusion.")
    if shadow_pass is not None and args.tolerance is not None:
        raise RleSplatError(
            "A shadow pass is made by a quality; remove --shadow-pass, or use --quality in place of --tolerance."
        )
    if wanted["indirect-light"] and not (args.shadows or args.light_recipe):
        raise RleSplatError("--indirect-light scatters light that casts shadows; add --shadows.")
    if args.shadows and args.lights is None and args.light_recipe is None:
        raise RleSplatError("--shadows needs lights; give some with --lights, because a headlight casts none.")


def refuse_light_effects(args) -> None:
    """Refuse these options for a .rle file, whose light is already encoded."""
    world = args.world is not None or args.environment is not None
    if args.light_recipe or args.shadows or world or args.ambient_occlusion or args.indirect_light:
        raise RleSplatError(
            f"The light of {args.volume} is already encoded; remove --light-recipe, --shadows, --world, --environment, "
            "--ambient-occlusion and --indirect-light, or render the original volume."
        )


def check_lighting(args, lighting, lights, camera) -> None:
    """Refuse options that ask for other lights than those of a .rle file; RleSplatError if they differ.

    Parameters
    ----------
    args : argparse.Namespace
        With ``volume``, ``no_shading``, ``lights`` and ``headlight``; an option that is not given is not checked.
    lighting : dict
        The description of the lights in the .rle file.
    lights : tuple of Light
        The lights of --lights.
    camera : Camera
        The camera, for the direction of a headlight.
    """
    if args.no_shading and lighting.get("shaded", True):
        raise RleSplatError(f"{args.volume} was encoded with shading; remove --no-shading, or encode it again.")
    if args.lights is not None and plain(lights) != lighting.get("lights"):
        raise RleSplatError(
            f"{args.volume} was encoded with other lights than {args.lights}; remove --lights, or encode it again."
        )
    headlight = lighting.get("headlight_direction")
    if args.headlight is False and headlight is not None:
        raise RleSplatError(f"{args.volume} was encoded with a headlight; remove --no-headlight, or encode it again.")
    if args.headlight and not _shines_along(headlight, depth_row(camera)[:3]):
        raise RleSplatError(
            f"{args.volume} was not encoded with a headlight from this view; remove --headlight, or encode it again."
        )


def _shines_along(headlight, looking) -> bool:
    return headlight is not None and bool(np.abs(np.subtract(headlight, looking)).max() <= DIRECTION_TOLERANCE)


def read_sky(args):
    """Read the picture of ``--environment``, before any volume: what ``read_environment`` returns, or None."""
    return None if args.environment is None else read_environment(args.environment)


def with_light_effects(args, scene: Scene, sky) -> Scene:
    """The scene with the shadows, world light, ambient occlusion and indirect light of the options; ``sky`` is of
    ``read_sky``."""
    scene = replace(
        scene, volume_shadows=args.shadows, ambient_occlusion=args.ambient_occlusion or 0.0,
        indirect_light=args.indirect_light or 0.0,
    )  # fmt: skip
    if sky is None:
        return replace(scene, world=None if args.world is None else tuple(args.world))
    mean, environment = sky
    headlight = scene.headlight and args.headlight is not None
    return replace(scene, world=mean, environment=environment, headlight=headlight)


def with_light_recipe(args, scene: Scene) -> Scene:
    """A scene lit by --light-recipe for its camera; other options go before what the recipe sets."""
    if args.light_recipe is None:
        return scene
    lit = add_lights(replace(scene, lights=()), args.light_recipe)
    function = set_smoothness(lit.transfer_function, args.smoothness)
    given = {name: getattr(args, name) for name in ("ambient_occlusion", "indirect_light")}
    changes = {name: value for name, value in given.items() if value is not None}
    return replace(lit, headlight=bool(args.headlight), transfer_function=function, **changes)
