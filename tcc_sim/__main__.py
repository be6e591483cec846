"""`python -m tcc_sim`: the same as the console script `tcc-sim`."""

import sys

from tcc_sim.cli import main

if __name__ == "__main__":
    sys.exit(main())
