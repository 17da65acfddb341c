"""`python -m lavsim`: the command line."""

import sys

from lavsim.cli import main

if __name__ == "__main__":
    sys.exit(main())
