"""Packaging of the nodes, their launch files and their configuration."""

import runpy
from glob import glob

from setuptools import find_packages, setup

NAME = "ros2_energy_monitor"
EXECUTABLES = runpy.run_path(f"{NAME}/executables.py")["EXECUTABLES"]

setup(
    name=NAME,
    version="0.3.0",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["base/*.xml", "meters/profiles/*.yaml"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", sorted(glob("launch/*.launch.py"))),
        (f"share/{NAME}/config", sorted(glob("config/*.yaml"))),
    ],
    entry_points={"console_scripts": [f"{name} = {NAME}.__main__:main" for name in EXECUTABLES]},
    install_requires=["setuptools"],
    # Not `tests_require`: with it newer setuptools make colcon find no tests.
    extras_require={
        "test": ["pytest"],
        "mqtt": ["paho-mqtt>=2.1,<3"],
        "opcua": ["asyncua>=2.1,<3"],
        "meters": ["paho-mqtt>=2.1,<3", "pymodbus>=3.16,<4", "requests>=2.28"],
    },
    zip_safe=False,
    maintainer="Robot energy maintainers",
    maintainer_email="maintainers@robot-energy.invalid",
    url="https://robot-energy.invalid",
    description="Nodes of the robot energy monitor.",
    license="Apache-2.0",
)
