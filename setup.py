"""Files that ROS 2 wants below share/; pyproject.toml has the metadata, for pip and for colcon (ament_python) alike."""

from glob import glob

from setuptools import setup

NAME = "tcc_sim"

setup(python_requires=">=3.10", data_files=[
    ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
    (f"share/{NAME}", ["package.xml"]),
    (f"share/{NAME}/config", sorted(glob("config/*.yaml"))),
    (f"share/{NAME}/launch", sorted(glob("config/*.launch.py"))),
])
