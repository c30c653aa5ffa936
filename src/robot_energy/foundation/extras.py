"""Libraries that only some parts need, and the extra of the distribution that brings them."""

from __future__ import annotations

from importlib.util import find_spec

from robot_energy.foundation.errors import MissingExtraError

EXTRAS = {
    "clarabel": "identify",
    "threadpoolctl": "identify",
    "polars": "logs",
    "matplotlib": "report",
    "trimesh": "printing",
    "shapely": "printing",
    "jinja2": "papers",
    "starlette": "dashboard",
    "uvicorn": "dashboard",
    "prometheus_client": "dashboard",
    "dask": "fleet",
    "distributed": "fleet",
    "fsspec": "fleet",
    "cryptography": "fleet",
    "mujoco": "studies",
}
COMPANIONS = "robot_energy_"
STUDIES = f"{COMPANIONS}studies"


def require(library: str, user: str) -> None:
    if find_spec(library) is None:
        raise missing(library, user)


def missing(library: str, user: str) -> MissingExtraError:
    """Return what to say of a module that is not installed, which ours need."""
    library = library.partition(".")[0]
    expected, remedy = "the whole library", "install it: pip install ./src in the clone"
    if library in EXTRAS:
        expected = f"the extra '{EXTRAS[library]}'"
        install = f"pip install './src[{EXTRAS[library]}]'"
        remedy = f"install it, in the clone: {install}, or {library} alone"
    elif library == STUDIES:
        expected, remedy = (
            "a clone, as it is not in the wheel",
            "run it in a clone, after make setup",
        )
    found = f"{user} needs {library}, which is not installed"
    return MissingExtraError(found, expected, remedy)


def is_ours(library: str) -> bool:
    library = library.partition(".")[0]
    return library in EXTRAS or library.startswith(COMPANIONS)
