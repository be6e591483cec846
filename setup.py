"""Package metadata, for pip and for colcon (ament_python) alike."""

import re
from glob import glob
from pathlib import Path

from setuptools import find_packages, setup

NAME = "tcc_sim"
HERE = Path(__file__).resolve().parent
VERSION = re.search(r'__version__ = "(.+)"', (HERE / NAME / "__init__.py").read_text()).group(1)

LINUX = 'platform_system == "Linux" and platform_machine == "x86_64"'
ROS = [f"{name}; {LINUX}" for name in (
    "ros-rclpy", "ros-rmw-fastrtps-cpp", "ros-std-msgs", "ros-sensor-msgs", "ros-std-srvs", "ros-diagnostic-msgs",
    "ros-rosgraph-msgs")]
VIEW = ["rerun-sdk>=0.26", "matplotlib>=3.6"]
CLUSTER = ["distributed>=2023.1"]
TEST = ["pytest>=7", "pytest-xdist>=3", "hypothesis>=6", "rosbags>=0.10", "mcap-ros2-support>=0.5", "ruff>=0.6",
        "mypy>=1.8",
        "types-PyYAML"]

setup(
    name=NAME,
    version=VERSION,
    description="Real-time slipping torque converter clutch driveline in ROS 2: stick-slip solvers, recorder, analysis",
    long_description=(HERE / "README.md").read_text() if (HERE / "README.md").exists() else "",
    long_description_content_type="text/markdown",
    license="Apache-2.0",
    maintainer="tcc_sim maintainers",
    maintainer_email="tcc-sim@users.noreply.example.org",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/config", sorted(glob("config/*.yaml"))),
    ],
    python_requires=">=3.10",
    install_requires=["numpy>=1.22", "scipy>=1.8", "numba>=0.57", "PyYAML>=5.4", "tqdm>=4.60", "mcap>=1.6", "zstandard",
                      "lz4"],
    extras_require={"ros": ROS, "view": VIEW, "cluster": CLUSTER, "test": TEST, "all": [*ROS, *VIEW, *CLUSTER, *TEST]},
    entry_points={"console_scripts": [
        "tcc-sim = tcc_sim.cli:main",
        "driveline_node = tcc_sim.nodes.executables:driveline_node",
        "recorder_node = tcc_sim.nodes.executables:recorder_node",
        "slip_controller_node = tcc_sim.nodes.executables:slip_controller_node",
    ]},
    options={
        "develop": {"script_dir": f"$base/lib/{NAME}"},
        "install": {"install_scripts": f"$base/lib/{NAME}"},
    },
    zip_safe=False,
)
