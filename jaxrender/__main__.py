"""``python -m jaxrender``: the command line."""

import sys

from jaxrender.cli import main

if __name__ == "__main__":
    sys.exit(main())
