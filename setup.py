"""Package metadata, for pip and for colcon (ament_python) alike."""

import re
from glob import glob
from pathlib import Path

from setuptools import find_packages, setup

NAME = "tcc_sim"
HERE = Path(__file__).resolve().parent
VERSION = re.search(r'__version__ = "(.+)"', (HERE / NAME / "__init__.py").read_text()).group(1)

# The oldest versions with which the tests pass on Python 3.10 and 3.11, of those without a published vulnerability.
# `.ci/floors` makes an environment with exactly these and runs the tests in it; newer Pythons need newer wheels.
INSTALL = ["numpy>=1.22.4", "scipy>=1.10", "numba>=0.62", "PyYAML>=6.0", "tqdm>=4.66.3", "mcap>=1.5", "zstandard>=0.16",
           "lz4>=4.2"]
LINUX = 'platform_system == "Linux" and platform_machine == "x86_64"'
ROS = [f"{name}; {LINUX}" for name in (
    "ros-rclpy", "ros-rmw-fastrtps-cpp", "ros-std-msgs", "ros-sensor-msgs", "ros-std-srvs", "ros-diagnostic-msgs",
    "ros-rosgraph-msgs")]
VIEW = ["rerun-sdk>=0.39", "matplotlib>=3.7"]
CLUSTER = ["distributed>=2026.1.1"]
TABLE = ["pandas>=1.5"]
TEST = ["pytest>=7", "pytest-xdist>=3.0.2", "pytest-timeout>=2.1", "hypothesis>=6.82", "jsonschema>=4.18",
        "rosbags>=0.10.8", "mcap-ros2-support>=0.5", "fmpy>=0.3.32",
        "ruff>=0.6", "mypy>=1.8", "types-PyYAML", "setuptools>=78.1.1"]

setup(
    name=NAME,
    version=VERSION,
    description="Real-time slipping torque converter clutch driveline in ROS 2: stick-slip solvers, recorder, analysis",
    long_description=(HERE / "README.md").read_text(encoding="utf-8") if (HERE / "README.md").exists() else "",
    long_description_content_type="text/markdown",
    license="Apache-2.0",
    maintainer="tcc_sim maintainers",
    maintainer_email="maintainers@tcc-sim.invalid",
    keywords=["ROS 2", "friction", "stick-slip", "clutch", "driveline", "torsional vibration", "hybrid systems", "MCAP",
              "Poincare section", "bifurcation"],
    classifiers=[
        "Development Status :: 4 - Beta",
        "Environment :: Console",
        "Intended Audience :: Science/Research",
        "Operating System :: POSIX :: Linux",
        "Programming Language :: Python :: 3",
        "Programming Language :: Python :: 3 :: Only",
        *(f"Programming Language :: Python :: 3.{minor}" for minor in range(10, 14)),
        "Topic :: Scientific/Engineering :: Physics",
        "Typing :: Typed",
    ],
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["py.typed"], f"{NAME}.fmu": ["c/*"], f"{NAME}.benchmarks": ["*.c"],
                  f"{NAME}.output": ["schemas/*.yaml"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/config", sorted(glob("config/*.yaml"))),
        (f"share/{NAME}/launch", sorted(glob("config/*.launch.py"))),
    ],
    python_requires=">=3.10",
    install_requires=INSTALL,
    extras_require={"ros": ROS, "view": VIEW, "cluster": CLUSTER, "table": TABLE,
                    "all": [*ROS, *VIEW, *CLUSTER, *TABLE],
                    "test": [*TEST, f'libcosimpy; {LINUX} and python_version >= "3.11"']},
    entry_points={"console_scripts": [
        "tcc-sim = tcc_sim.__main__:main",
        "driveline_node = tcc_sim.nodes.executables:driveline_node",
        "recorder_node = tcc_sim.nodes.executables:recorder_node",
        "slip_controller_node = tcc_sim.nodes.executables:slip_controller_node",
    ], "pytest11": ["tcc_sim = tcc_sim.testing.plugin"]},
    options={
        "develop": {"script_dir": f"$base/lib/{NAME}"},
        "install": {"install_scripts": f"$base/lib/{NAME}"},
    },
    zip_safe=False,
)
