"""Messages of a command in another process, for any state of the cache of kernels."""

import re

COMPILING = re.compile(r"^tcc-sim: compiling kernels for this kind of scene, about \d+ s, "
                       r"(once|in every process, since they cannot be kept)\n", re.MULTILINE)


def without_compiling(said: str) -> str:
    """Return standard error without the lines that announce compilation."""
    return COMPILING.sub("", said)
