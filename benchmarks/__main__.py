"""`python -m benchmarks NAME ...`: run one benchmark."""

import sys

from . import stages, systems

BENCHMARKS = {"stages": stages.main, "systems": systems.main}


def main(arguments) -> int:
    name = arguments[0] if arguments else "stages"
    if name not in BENCHMARKS:
        print(f"There is no benchmark {name!r}; choose {', '.join(BENCHMARKS)}.", file=sys.stderr)
        return 2
    return BENCHMARKS[name](arguments[1:])


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
