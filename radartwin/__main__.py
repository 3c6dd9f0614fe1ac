"""`python -m radartwin` runs the command line."""

import sys

from radartwin.cli import main

if __name__ == "__main__":
    sys.exit(main())
