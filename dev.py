#!/usr/bin/env python3
"""The one command of this repository: demo, test, bench, accuracy, calibrate, build, lint, blender, lock.

It needs nothing but Python 3.11 or 3.13 (the two that Blender 4.5 to 5.2 carry) and sets up the rest itself.
This file is written so that any older Python can read it far enough to say so.
"""

import sys

SUPPORTED = ((3, 11), (3, 13))

if sys.version_info[:2] not in SUPPORTED:
    sys.stderr.write(
        "dev.py needs Python 3.11 or 3.13, as Blender has, and this is Python %d.%d: "
        "install one of them and run it with that, for example 'python3.11 dev.py'.\n" % sys.version_info[:2]
    )
    sys.exit(2)

if __name__ == "__main__":
    from devtools.commands import main

    sys.exit(main(sys.argv[1:]))
