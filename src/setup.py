"""Packaging of the library `robot_energy` and the command `robot-energy`."""

import re
import sys
from pathlib import Path

from setuptools import Extension, find_packages, setup

NAME = "robot_energy"
HERE = Path(__file__).parent
# The one place of the version; package.xml repeats it for ROS, and a test compares them.
VERSION = re.search(r'^__version__ = "(.+)"$', (HERE / NAME / "__init__.py").read_text(), re.M)[1]

CORE = [
    "lz4>=4.3",
    "mcap>=1.1,<2",
    "numpy>=1.26,<3",
    "pin>=3.2,<5",
    "pydantic>=2.7,<3",
    "PyYAML>=6.0",
    "rich>=13.7",
    "rosbags>=0.10.5,<0.12",
    "scipy>=1.11.4",
    "shtab>=1.7",
    "tzdata>=2024.1",
    "zstandard>=0.22",
]
# Import packages of the distribution; robot_energy_studies stays in the clone.
COMPANIONS = ("cli", "fleet", "history", "identify", "logs", "papers", "plan", "report", "rig")
PACKAGES = [NAME, *(f"{NAME}_{companion}" for companion in COMPANIONS)]
IDENTIFY = ["clarabel>=0.9,<1", "threadpoolctl>=3.1"]
REPORT = ["matplotlib>=3.8"]
PRINTING = ["shapely>=2.0", "trimesh>=4.0"]
LOGS = ["polars>=2.1,<3"]
FLEET = [
    *("cryptography>=42", "distributed>=2025.1", "fsspec>=2024.2", "threadpoolctl>=3.1"),
    *LOGS,
]
DASHBOARD = ["prometheus-client>=0.20", "starlette>=0.37", "uvicorn>=0.30"]
PAPERS = ["Jinja2>=3.1", *IDENTIFY, *REPORT]

# Files of a colcon workspace; a wheel has its console script and needs none of them.
WORKSPACE = [
    ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
    (f"share/{NAME}", ["package.xml"]),
    # colcon puts `bin` on PATH; `ros2 run` finds the console script below.
    ("bin", ["bin/robot-energy"]),
]

# Without a compiler the library is installed all the same, see physics/kernels. The stable
# ABI of Python 3.11 serves all later versions; no instruction may be fused, so that all
# processors give the same bits.
KERNELS = Extension(
    f"{NAME}.physics.kernels._compiled",
    sorted(str(path.relative_to(HERE)) for path in HERE.glob(f"{NAME}/physics/kernels/*.c")),
    depends=[f"{NAME}/physics/kernels/kernels.h"],
    define_macros=[("Py_LIMITED_API", "0x030b0000")],
    extra_compile_args=["-O3", "-ffp-contract=off", "-fno-math-errno", "-Wno-psabi"],
    py_limited_api=True,
    optional=True,
)

setup(
    name=NAME,
    version=VERSION,
    packages=find_packages(include=[part for name in PACKAGES for part in (name, f"{name}.*")]),
    package_data={
        "": ["*.pyi", "py.typed", "README.md"],
        NAME: [
            "models/*.yaml",
            "models/*.urdf",
            "presets/*.yaml",
            # Copies of those of ros2_energy_msgs, so that the folder stands alone.
            "bag/cdr/msg/*.msg",
        ],
        f"{NAME}_papers": ["templates/*.j2"],
        f"{NAME}_report": ["page/static/*", "page/grafana/*"],
        f"{NAME}_rig": ["profiles/*.yaml"],
    },
    ext_modules=[KERNELS],
    options={"bdist_wheel": {"py_limited_api": "cp311"}},
    data_files=[] if "bdist_wheel" in sys.argv else WORKSPACE,
    entry_points={
        "console_scripts": ["robot-energy = robot_energy.__main__:main"],
        "robot_energy.commands": ["reproduce = robot_energy_papers.cli.reproduce"],
    },
    python_requires=">=3.11",
    install_requires=CORE,
    extras_require={
        "identify": IDENTIFY,
        "logs": LOGS,
        "printing": PRINTING,
        "report": REPORT,
        "dashboard": DASHBOARD,
        "fleet": FLEET,
        "papers": PAPERS,
        "studies": [*PAPERS, "mujoco>=3.2,<4"],  # of robot_energy_studies, in the clone
        "all": [*PAPERS, *DASHBOARD, *FLEET, *PRINTING],
        # Not `tests_require`: with it newer setuptools make colcon find no tests.
        "test": ["pytest", "hypothesis"],
    },
    zip_safe=False,
    maintainer="Robot energy maintainers",
    maintainer_email="maintainers@robot-energy.invalid",
    url="https://robot-energy.invalid",
    description="Energy monitoring of robots: where each watt goes, predicted and measured.",
    long_description="Energy monitoring of robots: model torques, temperature-aware friction, "
    "drive and cabinet losses, predicted against measured grid power; from recorded bags or "
    "planned motions. Runs without ROS.",
    license="Apache-2.0",
    classifiers=[
        "Intended Audience :: Science/Research",
        "Operating System :: POSIX :: Linux",
        "Programming Language :: Python :: 3.11",
        "Programming Language :: Python :: 3.12",
        "Topic :: Scientific/Engineering",
    ],
)
