"""`rosdep install` on Ubuntu 24.04 with Jazzy: every key is known, and has an apt package."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from places import ROOT

KEYS = Path(__file__).with_name("rosdep_keys.yaml")
FOLDERS = [str(ROOT / name) for name in ("src", "ros2_energy_monitor", "ros2_energy_msgs")]
# The index of distributions is empty: the file of keys holds the packages of Jazzy as well.
INDEX = "%YAML 1.1\n---\ndistributions: {}\ntype: index\nversion: 4\n"
PROGRAM = "import sys; from rosdep2.main import rosdep_main; sys.exit(rosdep_main())"


@pytest.fixture(scope="module")
def rosdep(tmp_path_factory):
    """The real tool, with the stored keys and without a network or a ROS installation."""
    folder = tmp_path_factory.mktemp("rosdep")
    (folder / "sources").mkdir()
    (folder / "sources/keys.list").write_text(f"yaml {KEYS.as_uri()}\n")
    (folder / "index.yaml").write_text(INDEX)
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("AMENT_", "ROS"))} | {
        "ROSDEP_SOURCE_PATH": str(folder / "sources"),
        "ROSDISTRO_INDEX_URL": (folder / "index.yaml").as_uri(),
        "ROS_HOME": str(folder / "home"),
    }

    def run(*words):
        return subprocess.run(
            [sys.executable, "-c", PROGRAM, *words],
            env=environment, capture_output=True, text=True, check=False, timeout=600,
        )  # fmt: skip

    done = run("update")
    assert done.returncode == 0, done.stderr
    return run


def install(rosdep, *folders):
    return rosdep(
        *("install", "--simulate", "--reinstall", "--from-paths", *folders, "--ignore-src"),
        *("--rosdistro", "jazzy", "--os", "ubuntu:noble"),
    )


def test_every_dependency_resolves_to_an_apt_package(rosdep):
    done = install(rosdep, *FOLDERS)
    assert done.returncode == 0, done.stderr
    commands = [line.split() for line in done.stdout.splitlines() if not line.startswith("#")]
    # Pip is refused by the system's Python of Ubuntu 24.04, and rosdep then installs nothing.
    assert {word for words in commands for word in words} >= {"apt-get", "ros-jazzy-rclpy"}
    assert not [words for words in commands if any("pip" in word for word in words)]


def test_a_key_that_is_none_is_found(rosdep, tmp_path):
    for folder in FOLDERS:
        text = Path(folder, "package.xml").read_text()
        (tmp_path / Path(folder).name).mkdir()
        (tmp_path / Path(folder).name / "package.xml").write_text(
            text.replace("python3-scipy", "python3-threadpoolctl")
        )
    done = install(rosdep, str(tmp_path))
    assert done.returncode != 0
    assert "python3-threadpoolctl" in done.stderr
