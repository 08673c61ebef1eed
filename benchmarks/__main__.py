"""`python -m benchmarks NAME ...`: run one benchmark."""

import sys

from rle_splat.scene import RleSplatError

from . import (
    accuracy,
    beyond_memory,
    calibrate,
    editing,
    effects,
    engine,
    history,
    labels,
    lamp_moves,
    large_picture,
    light,
    paper,
    plans,
    presets,
    reading,
    ripple,
    scaling,
    stages,
    systems,
    tolerance,
    turn,
    walls,
)

BENCHMARKS = {
    "stages": stages.main, "engine": engine.main, "paper": paper.main,
    "systems": systems.main, "scaling": scaling.main, "turn": turn.main, "editing": editing.main,
    "accuracy": accuracy.main, "tolerance": tolerance.main, "calibrate": calibrate.main,
    "effects": effects.main, "presets": presets.main, "plans": plans.main,
    "reading": reading.main, "beyond-memory": beyond_memory.main, "labels": labels.main,
    "large-picture": large_picture.main, "light": light.main, "ripple": ripple.main, "history": history.main,
    "walls": walls.main, "lamp-moves": lamp_moves.main,
}  # fmt: skip


def main(arguments) -> int:
    name = arguments[0] if arguments else "stages"
    if name in ("-h", "--help"):
        print("usage: dev.py bench [NAME] [options], and dev.py bench NAME --help for its options; NAME is one of\n")
        for other, run in BENCHMARKS.items():
            print(f"  {other:<15}{sys.modules[run.__module__].__doc__.splitlines()[0]}")
        return 0
    if name not in BENCHMARKS:
        print(f"There is no benchmark {name!r}; choose {', '.join(BENCHMARKS)}.", file=sys.stderr)
        return 2
    try:
        return BENCHMARKS[name](arguments[1:])
    except RleSplatError as problem:
        print(problem, file=sys.stderr)
        return 2


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
