"""A user without ROS: the wheel in an empty environment replays a bundled bag."""

import json
import os
import re
import subprocess
import sys
import venv
import zipfile
from importlib.metadata import PathDistribution, distribution

import pytest
from packaging.requirements import Requirement

from places import LIBRARY, ROOT

PINNED = re.compile(r"^[A-Za-z0-9_.-]+==[^\s\\;]+")


def run(*command, folder=ROOT):
    # Nothing of this environment may help: neither its packages nor its ROS.
    kept = ("PATH", "HOME", "PIP_", "SSL_", "http", "HTTP", "https", "HTTPS", "TMPDIR")
    environment = {k: v for k, v in os.environ.items() if k.startswith(kept)}
    done = subprocess.run(
        [str(word) for word in command],
        cwd=folder, env=environment, capture_output=True, text=True, check=False, timeout=600,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    dist = tmp_path_factory.mktemp("dist")
    run("make", "--silent", "wheel", f"DIST={dist}")
    return next(dist.glob("*.whl"))


def test_the_wheel_holds_library_models_and_messages_and_no_workspace(wheel):
    names = zipfile.ZipFile(wheel).namelist()
    assert any(name.endswith("models/kr16.yaml") for name in names)
    assert any(name.endswith("presets/ur.yaml") for name in names)
    assert any(name.endswith("msg/PowerState.msg") for name in names)
    assert "robot_energy_papers/templates/paper_a.md.j2" in names
    assert "robot_energy_report/page/static/index.html" in names
    assert "robot_energy_rig/profiles/kr16.yaml" in names
    packages = {path.name for path in LIBRARY}
    shipped = {name.partition("/")[0] for name in names if name.endswith(".py")}
    assert shipped == packages - {"robot_energy_studies"}
    assert all(f"{name}/README.md" in names for name in shipped - {"robot_energy"})
    assert not any(".data/" in name for name in names)
    assert "robot_energy/physics/kernels/_compiled.abi3.so" in names
    assert "-cp311-abi3-" in wheel.name  # one for all later versions of Python


def test_source_distribution_has_what_the_wheel_is_built_from(wheel):
    listing = run("tar", "tzf", next(wheel.parent.glob("*.tar.gz")))
    assert "package.xml" in listing
    assert "msg/PowerState.msg" in listing
    assert "templates/paper_b.md.j2" in listing
    assert "physics/kernels/inverse_dynamics.c" in listing
    assert "physics/kernels/kernels.h" in listing


@pytest.mark.long
def test_without_a_compiler_the_library_has_no_kernels(wheel, tmp_path):
    (tmp_path / "source").mkdir()
    run("tar", "xzf", next(wheel.parent.glob("*.tar.gz")), "-C", tmp_path / "source")
    source = next((tmp_path / "source").iterdir())
    run(
        "env", "CC=/bin/false", sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps",
        "--no-build-isolation", "--wheel-dir", tmp_path, source,
    )  # fmt: skip
    names = zipfile.ZipFile(next(tmp_path.glob("*.whl"))).namelist()
    assert "robot_energy/physics/kernels/__init__.py" in names
    assert not any(name.endswith(".so") for name in names)


def installed(wheel, folder, pip):
    """The wheel with what it needs from the index."""
    # The versions that the set-up pins, so that no release of tomorrow decides this test.
    lines = [
        match.group(0)
        for path in sorted((ROOT / ".ci").glob("requirements*.txt"))
        for match in map(PINNED.match, path.read_text().splitlines())
        if match
    ]
    pins = folder / "pins.txt"
    pins.write_text("\n".join(lines))
    # What is not imported is not compiled: that takes most of the time.
    run(*pip, "install", "--quiet", "--no-compile", "-c", pins, wheel, folder=folder)


def linked(wheel, folder, pip):
    """The wheel, and links to what it needs, directly or not, in this environment."""
    run(*pip, "install", "--quiet", "--no-compile", "--no-deps", "--no-index", wheel, folder=folder)
    (packages,) = (folder / "env/lib").glob("python3.*/site-packages")
    (own,) = packages.glob("robot_energy-*.dist-info")
    wanted, seen = [(line, "") for line in PathDistribution(own).requires], set()
    while wanted:
        line, extra = wanted.pop()
        requirement = Requirement(line)
        if requirement.marker is not None and not requirement.marker.evaluate({"extra": extra}):
            continue
        found = distribution(requirement.name)
        assert requirement.specifier.contains(found.version, prereleases=True), requirement
        for extra in {"", *requirement.extras} - {e for name, e in seen if name == found.name}:
            seen.add((found.name, extra))
            wanted += [(line, extra) for line in found.requires or ()]
        for name in {file.parts[0] for file in found.files} - {"..", "__pycache__"}:
            if not (packages / name).exists():
                (packages / name).symlink_to(found.locate_file(name))


@pytest.mark.parametrize("fill", [linked, pytest.param(installed, marks=pytest.mark.long)])
def test_the_wheel_replays_a_bag_in_an_empty_environment(wheel, tmp_path, fill):
    venv.create(tmp_path / "env", with_pip=False)
    python = tmp_path / "env/bin/python"
    fill(wheel, tmp_path, (sys.executable, "-m", "pip", "--python", python))
    report = tmp_path / "report.json"
    command = tmp_path / "env/bin/robot-energy"
    run(command, "replay", ROOT / "bags/kr16_cold", "--model", "kr16", "--json", report)
    expected = json.loads((ROOT / "test/golden/kr16_cold.json").read_text())
    found = json.loads(report.read_text())
    assert found["energy"]["grid_import"] == pytest.approx(expected["energy.grid_import"], rel=1e-9)
    version = run(python, "-c", "import robot_energy; print(robot_energy.__version__)")
    assert version.strip() in wheel.name
