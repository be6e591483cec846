"""What a command in a process of its own says, whatever is in the cache of compiled kernels."""

import re

COMPILING = re.compile(r"^tcc-sim: compiling kernels for this kind of scene, about \d+ s, "
                       r"(once|in every process, since they cannot be kept)\n", re.MULTILINE)


def without_compiling(said: str) -> str:
    """Standard error without the line of each process that says that kernels are being compiled."""
    return COMPILING.sub("", said)
