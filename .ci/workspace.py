"""Second half of the set-up: the virtual environment `.venv` and the colcon build.

Two stages, each with a stamp that holds a hash of all it depends on: a stage whose
stamp agrees is skipped, any other is made from scratch, so a killed set-up mends
itself. Standard library only; `.ci/setup` starts it with the interpreter to build for.

Leaves `.venv/env.sh`, to be sourced by users and by make, and the log of what was done in
`build/setup.log`. With files of requirements as arguments it only installs them into that
environment.
"""

import fcntl
import hashlib
import os
import re
import shlex
import shutil
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
CI = ROOT / ".ci"
VENV = ROOT / ".venv"
BUILD = ROOT / "build"
INSTALL = ROOT / "install"
LOG = BUILD / "setup.log"
ENV_SCRIPT = VENV / "env.sh"
VENV_PYTHON = VENV / "bin" / "python"
SITE = VENV / "lib" / f"python{sys.version_info[0]}.{sys.version_info[1]}" / "site-packages"
FIRST = CI / "requirements-build.txt"
REQUIREMENTS = [CI / "requirements-ros.txt", CI / "requirements.txt"]
MENDING = [CI / "mend_wheels.py", CI / "parsed_once.py"]
INTERFACES = "ros2_energy_msgs"
# For nodes in Python, and compiled in a third of the time of all types at -O3.
MESSAGES = (
    *("-GNinja", "-DWITH_CPP=OFF"),
    *("-DCMAKE_C_FLAGS_RELEASE=-O1", "-DCMAKE_CXX_FLAGS_RELEASE=-O1"),
)
# Settings of pip that uv does not read and that decide where a distribution comes from.
PIP_ALONE = re.compile(r"^\S+\.(index-url|no-index|proxy|client-cert)=", re.MULTILINE)
PYTHON_PACKAGES = {
    "robot_energy": ROOT / "src",
    "ros2_energy_monitor": ROOT / "ros2_energy_monitor",
}
# Files of a Python package that colcon must see again when they change; modules are
# linked into the installation and need no rebuild. Kernels are compiled.
PACKAGING = (
    *("package.xml", "setup.py", "setup.cfg", "resource/*", "bin/*", "launch/*", "config/*"),
    "robot_energy/physics/kernels/*.[ch]",
)
SMOKE_TEST = (
    "import rclpy, std_msgs.msg, pinocchio, mcap.reader, lz4.frame, zstandard, rosbags.highlevel, "
    "scipy.optimize, pydantic, matplotlib.figure, rich.console, yaml"
)
# Settings of the caller's shell that would leak another ROS, colcon or Python in.
FOREIGN = (
    *("PYTHON", "VIRTUAL_ENV", "PIP_USER", "PIP_TARGET", "PIP_PREFIX"),
    *("ROS_", "_ROS_WHEELS", "RMW_", "AMENT_", "COLCON_", "CMAKE_PREFIX_PATH", "LD_LIBRARY_PATH"),
)


class SetUpError(Exception):
    """A stage failed; the text says what and how to mend it."""


def main() -> int:
    """Bring environment and installation up to date and return the exit code."""
    BUILD.mkdir(exist_ok=True)
    started = time.monotonic()
    try:
        with only_one():
            if sys.argv[1:]:
                install([Path(name).resolve() for name in sys.argv[1:]])
                return 0
            worked = make_environment() | build_packages()
    except SetUpError as error:
        print(f"set-up: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("\nset-up: interrupted; start it again, it recovers by itself", file=sys.stderr)
        return 130
    if worked:
        print(f"set-up: ready after {time.monotonic() - started:.0f} s")
    return 0


@contextmanager
def only_one() -> Iterator[None]:
    """Hold the lock of this checkout, so that two set-ups do not mix.

    Children inherit it: if this process is killed, the next one waits for an orphan.
    """
    with (BUILD / "setup.lock").open("w") as lock:
        os.set_inheritable(lock.fileno(), True)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            print("set-up: waiting for another set-up of this folder", flush=True)
            fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def make_environment() -> bool:
    """Make `.venv` again unless it is complete and current; return whether it was made."""
    stamp = VENV / "complete"
    interpreter = (sys.version, os.path.realpath(sys.executable))
    key = hash_of([FIRST, *REQUIREMENTS, *MENDING], str(ROOT), *interpreter)
    if read(stamp) == key:
        write_env_script()
        return False
    LOG.unlink(missing_ok=True)
    if VENV.exists():
        unfinished = "" if stamp.exists() else "unfinished "
        with step(f"removing the {unfinished}environment of an earlier set-up"):
            stamp.unlink(missing_ok=True)
            shutil.rmtree(VENV)
    with step(f"virtual environment for Python {sys.version.split()[0]}"):
        run([sys.executable, "-I", "-m", "venv", VENV], "python -m venv failed")
    with step("Python packages: ROS 2 Jazzy, Pinocchio and others, 200 MB"):
        pip_install([FIRST])
        install(REQUIREMENTS)
        run([VENV_PYTHON, CI / "mend_wheels.py"], "the ROS wheels could not be mended")
    write_env_script()
    with step("checking that they load"):
        run([VENV_PYTHON, "-c", SMOKE_TEST], "an installed package does not load on this system")
    stamp.write_text(key)
    return True


def install(files: list[Path]) -> None:
    """Install what files of requirements pin: by uv, or by pip where uv cannot."""
    settings = subprocess.run(
        [VENV_PYTHON, "-m", "pip", "config", "list"],
        env=clean_environment(),
        capture_output=True,
        text=True,
        check=False,
    ).stdout
    if not PIP_ALONE.search(settings):
        uv = [VENV / "bin" / "uv", "pip", "install", "--python", VENV_PYTHON, "--system-certs"]
        try:
            run([*uv, *pinned(files)], "uv could not install the packages")
        except SetUpError as error:
            print(f"set-up: {error}; trying pip", file=sys.stderr)
        else:
            return
    pip_install(files)


def pip_install(files: list[Path]) -> None:
    """Install by pip what files of requirements pin: slower than uv, but by all settings of pip."""
    # Python compiles what is imported; all of it would take half a minute.
    quiet = ["--no-input", "--progress-bar=off", "--disable-pip-version-check", "--no-compile"]
    pip = [VENV_PYTHON, "-m", "pip", "install", *quiet, "--use-pep517", *pinned(files)]
    run(pip, "pip could not install the packages; check the network and start again")


def pinned(files: list[Path]) -> list[str | Path]:
    """Return the options for files of requirements that state all they need, by hash.

    empy is the one source distribution: it is built by what was installed before.
    """
    names = [word for path in files for word in ("-r", path)]
    return ["--no-deps", "--require-hashes", "--no-build-isolation", *names]


def build_packages() -> bool:
    """Build the three packages unless they are current; return whether they were built."""
    stamp = INSTALL / "complete"
    messages_stamp = INSTALL / INTERFACES / "complete"
    environment = read(VENV / "complete") or ""
    interfaces = [path for path in (ROOT / INTERFACES).rglob("*") if path.is_file()]
    messages_key = hash_of([*interfaces, ROOT / "colcon.meta"], environment, *MESSAGES)
    packaging = [
        path
        for folder in PYTHON_PACKAGES.values()
        for pattern in PACKAGING
        for path in folder.glob(pattern)
        if path.is_file()
    ]
    key = hash_of(packaging, messages_key)
    if read(stamp) == key:
        return False
    stale = list(PYTHON_PACKAGES)
    if not stamp.exists() or read(messages_stamp) != messages_key:
        stale.append(INTERFACES)
    if not stamp.exists():
        shutil.rmtree(INSTALL, ignore_errors=True)
    for name in stale:
        shutil.rmtree(BUILD / name, ignore_errors=True)
        shutil.rmtree(INSTALL / name, ignore_errors=True)
    stamp.unlink(missing_ok=True)
    what = "messages and nodes" if INTERFACES in stale else "nodes"
    with step(f"building {what} with colcon"):
        command = [
            *(VENV / "bin" / "colcon", "--log-base", BUILD / "log", "build", "--symlink-install"),
            *("--base-paths", ROOT, "--metas", ROOT / "colcon.meta"),
            *("--build-base", BUILD, "--install-base", INSTALL),
            *("--cmake-args", f"-DPython3_EXECUTABLE={VENV_PYTHON}", *MESSAGES),
            # Links for the messages take longer than copies; a change of one makes all again.
            *("--ament-cmake-args", "-DAMENT_CMAKE_SYMLINK_INSTALL=OFF"),
        ]
        # Otherwise colcon starts no second compiler while the load is above the number of cores.
        jobs = f"-j{len(os.sched_getaffinity(0))}"
        run(command, "colcon could not build the packages", MAKEFLAGS=jobs)
    messages_stamp.write_text(messages_key)
    stamp.write_text(key)
    return True


def write_env_script() -> None:
    """Write `.venv/env.sh` with the paths of this checkout."""
    text = (CI / "env.sh.in").read_text()
    libraries = [VENV / "lib", *sorted(SITE.glob("ros_*.libs"))]
    values = {"@ROOT@": str(ROOT), "@LIBRARIES@": ":".join(map(str, libraries))}
    for name, value in values.items():
        text = text.replace(name, shlex.quote(value))
    if read(ENV_SCRIPT) != text:
        ENV_SCRIPT.write_text(text)


def clean_environment() -> dict[str, str]:
    """Return the caller's environment without settings of another ROS, colcon or Python."""
    environment = {k: v for k, v in os.environ.items() if not k.startswith(FOREIGN)}
    libraries = [VENV / "lib", *sorted(SITE.glob("ros_*.libs"))]
    return environment | {
        "PATH": f"{VENV / 'bin'}:{os.environ.get('PATH', os.defpath)}",
        "VIRTUAL_ENV": str(VENV),
        "PYTHONNOUSERSITE": "1",
        "AMENT_PREFIX_PATH": str(VENV),
        "CMAKE_PREFIX_PATH": str(VENV),
        "LD_LIBRARY_PATH": ":".join(map(str, libraries)),
        "_ROS_WHEELS_BOOTSTRAP_COMPLETE": "1",
        "ROS_DISTRO": "jazzy",
        "ROS_VERSION": "2",
        "ROS_PYTHON_VERSION": "3",
        "ROS_LOG_DIR": str(BUILD / "ros_log"),
        "COLCON_HOME": str(BUILD / "colcon_home"),
        "MPLCONFIGDIR": str(BUILD / "matplotlib"),
    }


def run(command: list[str | Path], failure: str, **extra: str) -> None:
    """Run a command with its output in the log; show the end of the log if it fails."""
    words = [str(word) for word in command]
    with LOG.open("a") as log:
        log.write(f"\n$ {shlex.join(words)}\n")
        log.flush()
        start = log.tell()
        code = subprocess.run(
            words,
            cwd=ROOT,
            env=clean_environment() | extra,
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=subprocess.STDOUT,
            close_fds=False,
            check=False,
        ).returncode
    if code:
        with LOG.open(errors="replace") as log:
            log.seek(start)
            tail = log.read().splitlines()[-25:]
        print("", *tail, sep="\n    ", file=sys.stderr)
        raise SetUpError(f"{failure} (exit code {code}; whole log: {LOG})")


@contextmanager
def step(what: str) -> Iterator[None]:
    """Print what is done and how long it took."""
    started = time.monotonic()
    print(f"set-up: {what} ...", end="", flush=True)
    try:
        yield
    except BaseException:
        print(" failed", flush=True)
        raise
    print(f" {time.monotonic() - started:.0f} s", flush=True)


def hash_of(paths: Iterable[Path], *words: str) -> str:
    """Return a hash over the names and contents of files and over words."""
    digest = hashlib.sha256()
    for path in sorted(paths):
        digest.update(f"{path.relative_to(ROOT)}\0".encode() + path.read_bytes() + b"\0")
    for word in words:
        digest.update(word.encode() + b"\0")
    return digest.hexdigest()


def read(path: Path) -> str | None:
    """Return the text of a file, or None if there is none."""
    try:
        return path.read_text()
    except (FileNotFoundError, NotADirectoryError):
        return None


if __name__ == "__main__":
    sys.exit(main())
