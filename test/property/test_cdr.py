"""Wire format against rosbags: random definitions, random messages, random damage."""

import keyword

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rosbags.interfaces import Nodetype

from robot_energy.bag.cdr import Decoder, Encoder, RawBatch, typestore
from robot_energy.bag.cdr.schema import compile_schema, leaf_paths
from robot_energy.bag.cdr.types import extended

TYPES = [
    "sensor_msgs/msg/JointState",
    "sensor_msgs/msg/Temperature",
    "std_msgs/msg/Float64",
    "std_msgs/msg/Empty",
    "diagnostic_msgs/msg/DiagnosticArray",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    "trajectory_msgs/msg/JointTrajectory",
    "sensor_msgs/msg/BatteryState",
    "ros2_energy_msgs/msg/JointTorque",
    "ros2_energy_msgs/msg/JointFriction",
    "ros2_energy_msgs/msg/PowerState",
    "ros2_energy_msgs/msg/EnergyRegisters",
    "ros2_energy_msgs/msg/PowerReading",
]
PROFILE = settings(
    max_examples=30,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)
INTEGERS = {
    name: (int(np.iinfo(name).min), int(np.iinfo(name).max))
    for name in ["int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64"]
} | {"byte": (0, 127), "char": (0, 255)}
DTYPES = {"byte": "uint8", "char": "uint8"}
TEXT = st.text(
    st.characters(codec="utf-8", exclude_characters="\x00"), max_size=6
) | st.sampled_from(["joint_1", "joint_2", ""])


def base_values(name):
    if name == "string":
        return TEXT
    if name == "bool":
        return st.booleans()
    if name in INTEGERS:
        return st.integers(*INTEGERS[name])
    return st.floats(width=32 if name == "float32" else 64)


def values(description, store):
    kind, detail = description
    if kind == Nodetype.BASE:
        return base_values(detail[0])
    if kind == Nodetype.NAME:
        return objects(detail, store)
    item, count = detail
    low, high = (count, count) if kind == Nodetype.ARRAY else (0, 3)
    items = st.lists(values(item, store), min_size=low, max_size=high)
    if item[0] == Nodetype.BASE and item[1][0] != "string":
        return items.map(lambda x: np.array(x, dtype=DTYPES.get(item[1][0], item[1][0])))
    return items


def objects(msgtype, store):
    fields = [values(description, store) for _, description in store.fielddefs[msgtype][1]]
    return st.tuples(*fields).map(lambda parts: store.types[msgtype](*parts))


def field(message, names):
    """Return the value at a path of a rosbags message, nested lists for arrays of messages."""
    if not names:
        return message
    if isinstance(message, list):
        return [field(item, names) for item in message]
    name = names[0] + "_" if keyword.iskeyword(names[0]) else names[0]
    return field(getattr(message, name), names[1:])


def same(column, j, expected):
    """Whether row j of a column is what rosbags decodes."""
    if isinstance(column, str):
        return column == expected
    if isinstance(column, np.ndarray):
        value, wanted = column[j], np.asarray(expected)
        if value.dtype == np.uint8:  # rosbags takes ROS's byte for a signed number
            wanted = wanted.astype(np.uint8)
        if value.dtype == np.bool_:
            wanted = wanted.view(np.uint8) != 0
        if wanted.size == 0:
            return value.size == 0
        return value.shape == wanted.shape and bool(
            np.array_equal(value, wanted, equal_nan=wanted.dtype.kind == "f")
        )
    if len(column) != len(expected):
        return False
    return all(
        a == b if isinstance(a, str) else same(a, j, b)
        for a, b in zip(column, expected, strict=True)
    )


def check_equal(msgtype, rows, store, decoder=None):
    """Decode rows by layout and one by one with rosbags: the same rows, the same values."""
    paths = leaf_paths(compile_schema(msgtype, store))
    decoder = decoder or Decoder(msgtype, paths, store)
    decoded = decoder.decode(RawBatch.from_messages("/t", msgtype, range(len(rows)), rows))
    seen = sorted(decoded.malformed.tolist() + [i for run in decoded.runs for i in run.rows])
    assert seen == list(range(len(rows)))
    for i in decoded.malformed:
        assert deserialize(store, rows[i], msgtype) is None
    for run in decoded.runs:
        for j, i in enumerate(run.rows):
            message = deserialize(store, rows[i], msgtype)
            assert message is not None
            for path in paths:
                assert same(run.columns[path], j, field(message, path.split("."))), path
    return decoded


def deserialize(store, data, msgtype):
    try:
        return store.deserialize_cdr(data, msgtype)
    except Exception:
        return None


def serialized(store, messages, orders):
    return [
        bytes(store.serialize_cdr(m, m.__msgtype__, little_endian=little))
        for m, little in zip(messages, orders, strict=False)
    ]


@PROFILE
@given(st.data(), st.sampled_from(TYPES))
def test_random_messages_decode_as_rosbags_decodes_them(data, msgtype):
    store = typestore()
    messages = data.draw(st.lists(objects(msgtype, store), min_size=1, max_size=4))
    rows = serialized(store, messages * 2, data.draw(st.lists(st.booleans(), min_size=8)))
    decoded = check_equal(msgtype, rows, store)
    assert decoded.malformed.size == 0


@st.composite
def definitions(draw):
    """Two message definitions, the outer one made of the inner one and of anything else."""
    bases = [*INTEGERS, "bool", "string", "float32", "float64"]
    suffix = st.sampled_from(["", "", "[]", "[2]", "[<=3]"])

    def body(kinds):
        fields = draw(st.lists(st.tuples(st.sampled_from(kinds), suffix), min_size=1, max_size=6))
        return "".join(f"{kind}{many} f{i}\n" for i, (kind, many) in enumerate(fields))

    inner = body(bases)
    return {
        "a/msg/Inner": ("ros2msg", inner),
        "a/msg/Outer": ("ros2msg", body([*bases, "a/Inner", "a/Inner"])),
    }


@PROFILE
@given(st.data(), definitions())
def test_random_definitions_decode_as_rosbags_decodes_them(data, definition):
    store = extended(typestore(), definition)
    messages = data.draw(st.lists(objects("a/msg/Outer", store), min_size=1, max_size=3))
    rows = serialized(store, messages, data.draw(st.lists(st.booleans(), min_size=3)))
    decoded = check_equal("a/msg/Outer", rows, store)
    assert decoded.malformed.size == 0


@PROFILE
@given(st.data(), st.sampled_from(TYPES), st.booleans())
def test_damage_is_found_or_decodes_as_rosbags_decodes_it(data, msgtype, little):
    store = typestore()
    (good,) = serialized(store, [data.draw(objects(msgtype, store))], [little])
    rows = [good, *(good[:i] for i in range(len(good)))]
    flips = st.lists(st.integers(0, 8 * len(good) - 1), min_size=1, max_size=3)
    for bits in data.draw(st.lists(flips, min_size=20, max_size=60)):
        damaged = bytearray(good)
        for bit in bits:
            damaged[bit // 8] ^= 1 << bit % 8
        rows.append(bytes(damaged))
    rows += data.draw(st.lists(st.binary(max_size=64), max_size=5))
    check_equal(msgtype, rows, store)


@PROFILE
@given(st.data(), st.sampled_from(TYPES))
def test_how_messages_are_cut_into_batches_changes_nothing(data, msgtype):
    store = typestore()
    kinds = data.draw(st.lists(objects(msgtype, store), min_size=1, max_size=3))
    order = data.draw(st.lists(st.integers(0, len(kinds) - 1), min_size=1, max_size=12))
    rows = serialized(store, [kinds[i] for i in order], [True] * len(order))
    decoder = Decoder(msgtype, leaf_paths(compile_schema(msgtype, store)), store)
    cut = data.draw(st.integers(0, len(rows)))
    for part in (rows, rows[:cut], rows[cut:], rows):
        check_equal(msgtype, part, store, decoder)


@PROFILE
@given(
    names=st.lists(TEXT, max_size=4),
    frame=TEXT,
    sizes=st.tuples(*[st.integers(0, 4)] * 3),
    n=st.integers(0, 5),
    seed=st.integers(0, 2**32 - 1),
)
def test_encoded_rows_are_the_bytes_rosbags_writes(names, frame, sizes, n, seed):
    store, msgtype = typestore(), "sensor_msgs/msg/JointState"
    random = np.random.default_rng(seed)
    arrays = {
        key: random.normal(size=(n, size))
        for key, size in zip(["position", "velocity", "effort"], sizes, strict=True)
    }
    stamp = {
        "header.stamp.sec": random.integers(-(2**31), 2**31, n),
        "header.stamp.nanosec": random.integers(0, 2**32, n),
    }
    lengths = {key: array.shape[1] for key, array in arrays.items()}
    encoder = Encoder(msgtype, {"header.frame_id": frame, "name": tuple(names)}, lengths)
    rows = encoder.encode(arrays | stamp, n)
    make = store.types
    for i in range(n):
        time = make["builtin_interfaces/msg/Time"](*(int(c[i]) for c in stamp.values()))
        header = make["std_msgs/msg/Header"](time, frame)
        message = make[msgtype](header, names, *(array[i] for array in arrays.values()))
        assert rows[i].tobytes() == bytes(store.serialize_cdr(message, msgtype))
