"""Options of the light that reaches voxels: shadows, the world's light, ambient occlusion."""

from __future__ import annotations

from dataclasses import replace

from ..scene import RleSplatError, Scene


def add_light_effect_options(parser) -> None:
    group = parser.add_argument_group("shadows and ambient light")
    group.add_argument(
        "--shadows", action="store_true",
        help="let the lights of --lights that cast shadows cast them in the volume; a headlight never does",
    )
    group.add_argument(
        "--world", nargs=3, type=float, metavar=("R", "G", "B"),
        help="scene-linear radiance that comes from everywhere, as of Blender's world",
    )
    group.add_argument(
        "--ambient-occlusion", type=float, default=0.0, metavar="STRENGTH",
        help="how much of the light from everywhere is taken away where the sky is hidden, 0 to 1",
    )
    group.add_argument(
        "--shadow-pass", metavar="FILE",
        help="write another picture, of the share of each pixel's light that shadows and ambient occlusion take away",
    )


def check_light_effects(args) -> None:
    """Refuse what contradicts itself, or would do nothing, before anything is read."""
    wanted = {
        "shadows": args.shadows, "world": args.world is not None, "ambient-occlusion": args.ambient_occlusion != 0.0,
    }
    name = next((name for name, given in wanted.items() if given), None)
    if name is not None and args.no_shading:
        raise RleSplatError(f"--no-shading and --{name} contradict each other; give one of the two.")
    if args.shadow_pass is not None and not (args.shadows or args.ambient_occlusion):
        raise RleSplatError("--shadow-pass is of shadows; add --shadows or --ambient-occlusion.")
    if args.shadow_pass is not None and args.tolerance is not None:
        raise RleSplatError("--tolerance is of light without shadows; leave --shadow-pass out, or choose a --quality.")
    if args.shadows and args.lights is None:
        raise RleSplatError("--shadows are those of lights; give some with --lights, for a headlight casts none.")


def refuse_light_effects(args) -> None:
    """Refuse them all for a `.rle` file, whose light is what it is."""
    if args.shadows or args.world is not None or args.ambient_occlusion != 0.0:
        raise RleSplatError(
            f"{args.volume} is lit as it was encoded; leave --shadows, --world and --ambient-occlusion out, or render "
            "the volume it was encoded from."
        )


def with_light_effects(args, scene: Scene) -> Scene:
    world = None if args.world is None else tuple(args.world)
    return replace(scene, volume_shadows=args.shadows, world=world, ambient_occlusion=args.ambient_occlusion)
