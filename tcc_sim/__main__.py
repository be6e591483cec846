"""`python -m tcc_sim` and the console script `tcc-sim`."""

import os
import signal
import sys
from contextlib import suppress

if signal.getsignal(signal.SIGINT) is signal.default_int_handler and (
        __name__ == "__main__" or sys.argv[0].endswith("tcc-sim")):
    # Ctrl-C during the imports ends the program without a traceback; `main` sets its own handling.
    signal.signal(signal.SIGINT, signal.SIG_DFL)

# On small matrices threads of OpenBLAS only wait for each other; NumPy reads this when it is loaded.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

with suppress(OSError), open("/proc/cpuinfo", "rb") as cores:
    if {b"avx2", b"fma"} <= set(cores.read(8192).split()):
        # The same loops of OpenBLAS on each such processor: results are equal to the last bit.
        os.environ["OPENBLAS_CORETYPE"] = "Haswell"

from tcc_sim.cli import main

if __name__ == "__main__":
    sys.exit(main())
