#!/usr/bin/env python3
"""The one command of this repository: "python3 dev.py JOB ARGUMENTS"; without a job it lists the jobs.

Any Python from 3.9 on can start it.  It needs nothing else: it makes .venvs/tools with uv and nox, from pinned and
hashed requirements, and hands over to noxfile.py.  An older Python can read this file and says what it needs.
"""

import sys

if sys.version_info < (3, 9):
    sys.stderr.write(
        "dev.py needs Python 3.9 or newer, and this is Python %d.%d: "
        "run it with a newer one, for example 'python3.12 dev.py'.\n" % sys.version_info[:2]
    )
    sys.exit(2)

if __name__ == "__main__":
    from devtools.bootstrap import main

    sys.exit(main(sys.argv[1:]))
