"""Packaging of the library `robot_energy` and the command `robot-energy`."""

from setuptools import find_packages, setup

NAME = "robot_energy"

setup(
    name=NAME,
    version="0.1.0",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={
        NAME: [
            "py.typed",
            "models/*.yaml",
            "models/*.urdf",
            # A link to the interface package: one source of truth for the messages.
            "wire/msg/*.msg",
        ]
    },
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        # colcon puts `bin` on PATH; `ros2 run` finds the console script below.
        ("bin", ["bin/robot-energy"]),
    ],
    entry_points={"console_scripts": ["robot-energy = robot_energy.cli:main"]},
    install_requires=["setuptools"],
    # Not `tests_require`: with it newer setuptools make colcon find no tests.
    extras_require={"test": ["pytest"]},
    zip_safe=False,
    maintainer="Robot energy maintainers",
    maintainer_email="maintainers@robot-energy.invalid",
    description="Where each watt of a robot goes: predicted beside measured, live and from bags.",
    license="Apache-2.0",
)
