"""What colcon cannot read in setup.cfg, which has all other metadata: the README, and files below share/ for ROS 2."""

from glob import glob
from pathlib import Path

from setuptools import setup

NAME = "tcc_sim"
SOURCE = Path(__file__).resolve().parent  # --symlink-install runs this file in a folder of links, without the README.

setup(python_requires=">=3.10", long_description=(SOURCE / "README.md").read_text(), data_files=[
    ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
    (f"share/{NAME}", ["package.xml"]),
    (f"share/{NAME}/config", sorted(glob("config/*.yaml"))),
    (f"share/{NAME}/launch", sorted(glob("config/*.launch.py"))),
])
