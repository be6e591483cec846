"""`python -m tcc_sim` and the console script `tcc-sim`."""

import signal
import sys

if signal.getsignal(signal.SIGINT) is signal.default_int_handler and (
        __name__ == "__main__" or sys.argv[0].endswith("tcc-sim")):
    # While the program is loaded Ctrl-C ends it without a traceback; `main` takes it from there.
    signal.signal(signal.SIGINT, signal.SIG_DFL)

from tcc_sim.cli import main

if __name__ == "__main__":
    sys.exit(main())
