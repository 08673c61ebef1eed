"""``python -m rle_splat``: the command line."""

import sys

from .cli.main import run_process

if __name__ == "__main__":
    sys.exit(run_process())
