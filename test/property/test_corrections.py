"""Sign, scale and zero give the same for a log, for a bag of it, and however the bag is cut."""

from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from logbook import mapping, write_csv
from robot_energy.bag import BagReader
from robot_energy.inputs.joint_states.correction import JointCorrection
from robot_energy.inputs.joint_states.joint_states import JointStateIngest
from robot_energy.inputs.sources import JointStateSource
from robot_energy.timeline.blocks import JointBlock
from robot_energy_logs.log_import import import_log

NAMES = ("one", "two", "three")
GROUPS = {
    "position": {"column": "q_{joint}", "unit": "deg"},
    "velocity": {"column": "w_{joint}", "unit": "deg_per_s"},
    "effort": {"column": "i_{joint}", "unit": "milliampere"},
}


def entries(values):
    return st.lists(values, min_size=1, max_size=1) | st.lists(values, min_size=3, max_size=3)


corrections = st.fixed_dictionaries(
    {
        name: st.fixed_dictionaries(
            {
                "sign": entries(st.sampled_from([1, -1])),
                "scale": entries(st.floats(1e-2, 2)),
                "zero": entries(st.floats(-3, 3)),
            }
        )
        for name in GROUPS
    }
)


def states(bag, bounds=(), **made):
    """What an ingest makes of a bag that it gets in pieces."""
    ingest = JointStateIngest(NAMES, source=JointStateSource(**made), effort=True)
    whole = [part["/joint_states"] for part in BagReader(bag).parts(["/joint_states"])]
    blocks = []
    for batch in whole:
        edges = [0, *sorted(min(bound, len(batch)) for bound in bounds), len(batch)]
        blocks += [ingest.step(batch[slice(a, b)]) for a, b in pairwise(edges)]
    blocks.append(ingest.flush())
    return JointBlock.concatenate([block for block in blocks if block is not None])


@settings(deadline=None, max_examples=12)
@given(
    given_corrections=corrections,
    seed=st.integers(0, 2**31),
    bounds=st.lists(st.integers(0, 40), max_size=5),
)
def test_a_log_and_its_bag_are_corrected_alike(given_corrections, seed, bounds):
    rng = np.random.default_rng(seed)
    header = ",".join(["t", *(f"{kind}_{name}" for kind in "qwi" for name in NAMES)])
    walk = rng.uniform(-1, 1, (40, 3)).cumsum(axis=0)  # deg; a joint that leaps is refused
    rows = np.column_stack([np.arange(40) / 100, walk, rng.normal(0, 90, (40, 6))]).tolist()
    with TemporaryDirectory() as name:
        log = write_csv(Path(name) / "log.csv", header, rows)
        for folder, added in (("plain", {}), ("corrected", given_corrections)):
            groups = {key: {**group, **added.get(key, {})} for key, group in GROUPS.items()}
            import_log(
                log, mapping(joints={"names": NAMES, **groups}, power=None), Path(name) / folder
            )
        made = {
            key: JointCorrection(
                **{word: tuple(map(float, values)) for word, values in found.items()}
            )
            for key, found in given_corrections.items()
        }
        by_log = states(Path(name) / "corrected")
        by_bag = states(Path(name) / "plain", **made)
        in_pieces = states(Path(name) / "plain", bounds, **made)
    for array in ("stamp_ns", "joint_position", "joint_velocity", "joint_effort"):
        expected = getattr(by_log, array)
        np.testing.assert_array_equal(getattr(by_bag, array), expected)
        np.testing.assert_array_equal(getattr(in_pieces, array), expected)
    logged = np.array([row[1:] for row in rows]) * np.repeat([np.pi / 180, np.pi / 180, 1e-3], 3)
    for place, name in enumerate(GROUPS):
        words = given_corrections[name]
        sign, scale, zero = (np.asarray(words[word]) for word in ("sign", "scale", "zero"))
        expected = sign * scale * logged[:, 3 * place : 3 * place + 3] + zero
        np.testing.assert_allclose(
            getattr(by_log, f"joint_{name}"), expected, rtol=1e-12, atol=1e-12
        )
