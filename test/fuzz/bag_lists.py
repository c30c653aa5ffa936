"""Tables and addresses of the bags of a fleet: each row is a bag or names its problem."""

import glob
import os
from unittest import mock

import fsspec
from target import done, in_file, scratch

from robot_energy_fleet import bag_places
from robot_energy_fleet.bag_list import FleetModels, list_bags
from robot_energy_fleet.bag_places import Folders, find_bags
from robot_energy_fleet.bag_row import refused

MODELS = FleetModels()
HEADER = b"bag,model,robot,programme,shift,jobs,effort\n"


class _ClientError(Exception):
    """What a client of an object store raises: no error of Python's own."""


def _client(address: str):
    """Nothing is asked of a network: some clients refuse, others hold nothing."""
    if address.startswith("memory"):
        return fsspec.core.url_to_fs(address)
    raise (_ClientError, ImportError, ValueError, OSError)[len(address) % 4](address)


def _below(roots: list[str]) -> list[str]:
    """Places of this target: nobody's disk is searched."""
    own = f"{scratch()}/"
    return [root for root in roots if f"{os.path.realpath(root)}/".startswith(own)]


class _Own(Folders):
    def add(self, roots: list[str]) -> None:
        super().add(_below(roots))


def _glob(pattern: str, **words):
    return glob.glob(pattern, **words) if _below([pattern.partition("*")[0]]) else []


def addresses(data: bytes) -> bool:
    """Rows of a table, and what they hold as an address of its own."""
    table = in_file("bags.csv", HEADER + data)
    (scratch() / "r1").mkdir(exist_ok=True)
    in_file("r1/a.mcap", b"no bag")
    with (
        mock.patch.object(bag_places, "url_to_fs", _client),
        mock.patch.object(bag_places, "Folders", _Own),
        mock.patch.object(bag_places, "glob", mock.Mock(glob=_glob)),
    ):
        taken = done(lambda: _rows(list_bags(str(table), MODELS, "kr16", {})))
        text = data.partition(b",")[0].decode(errors="surrogateescape")
        return done(lambda: list(find_bags(text))) or taken


def _rows(bags) -> None:
    assert bags
    for bag in bags:
        problem = bag.place.problem
        if problem is None:
            assert bag.model_digest in MODELS.models
            continue
        row = refused(bag, problem)
        assert row.key.reason
        assert row.key.robot


def address_seeds() -> list[bytes]:
    """What is understood, and what is not."""
    return [
        b'r1/a.mcap,,left,pick,early,,motor_torque\nr1,ur5e,,,,,\nr1/*.mcap\n"r1",kr16\n',
        b"s3://recordings/2026\nhttp://127.0.0.1/a.mcap\nmemory://hall\nfile:///tmp/x\n~/a\n",
        b"data:text/plain,x\nzip://a.mcap\ngithub://a:b@c/d\n~nobody/x\nsimplecache::s3://b\n",
        b"gone.mcap,no_model,r,,,none.yaml,wrong\n,x\na,b,c,d,e,f,g,h\n\xff\n",
    ]
