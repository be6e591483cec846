"""Metadata that colcon cannot read in setup.cfg (the README, files below share/ for ROS 2), and the kernels that are
compiled ahead. Without Numba, or with TCC_SIM_KERNELS=none, the package is built without them.
"""

import os
import shutil
import subprocess
import sys
from glob import glob
from pathlib import Path

from setuptools import Extension, setup
from setuptools.command.build_ext import build_ext

NAME = "tcc_sim"
SOURCE = Path(__file__).resolve().parent  # --symlink-install runs this file in a folder of links, without the README.


class CompileKernels(build_ext):
    """Compiles the package's kernels, in the place of C extensions; where it fails, the first runs compile them."""

    def run(self):
        """Compile them into the build, or beside the source of an editable installation."""
        place = SOURCE if self.inplace or getattr(self, "editable_mode", False) else Path(self.build_lib).absolute()
        folder = place / NAME / "compiling" / "shipped"
        built = next(SOURCE.glob(f"build/lib*/{NAME}/compiling/shipped"), None)
        if built and not folder.exists():  # By `pip install .`, so that `pip install -e .` after it need not wait.
            shutil.copytree(built, folder)
        subprocess.run([sys.executable, "-m", f"{NAME}.study.cli.ahead", str(folder)], cwd=SOURCE, check=False)

    def get_outputs(self):
        """Return no file: install_lib copies the folder."""
        return []

    def get_output_mapping(self):
        """Return no file, in an editable installation too."""
        return {}


def why_without_kernels():
    """Return why no kernels are compiled ahead; empty if they are."""
    if os.environ.get("TCC_SIM_KERNELS") == "none":
        return "TCC_SIM_KERNELS is none"
    sys.path.insert(0, str(SOURCE))
    try:
        from tcc_sim.compiling.compiled import not_to_ship

        return not_to_ship()
    except ImportError as error:
        return f"the build has no package {error.name}"
    finally:
        sys.path.remove(str(SOURCE))


without = why_without_kernels()
if without:
    sys.stderr.write(f"{NAME}: built without kernels, so first runs compile them: {without}\n")
    kernels = {}
else:
    kernels = {"ext_modules": [Extension(f"{NAME}.compiling.shipped", [])], "cmdclass": {"build_ext": CompileKernels}}

setup(**kernels, python_requires=">=3.10", long_description=(SOURCE / "README.md").read_text(), data_files=[
    ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
    (f"share/{NAME}", ["package.xml"]),
    (f"share/{NAME}/config", sorted(glob("config/*.yaml") + glob("config/*.xml"))),
    (f"share/{NAME}/launch", sorted(glob("config/*.launch.py"))),
])
