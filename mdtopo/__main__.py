"""``python -m mdtopo`` is the command ``mdtopo``."""

import sys

from mdtopo.cli import main

if __name__ == "__main__":
    sys.exit(main())
