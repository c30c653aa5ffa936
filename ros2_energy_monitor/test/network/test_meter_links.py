# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""What links read of real servers, against registers and documents made by other means."""

from __future__ import annotations

import hashlib
import json
import re
import struct
import sys
import threading
import time
from pathlib import Path

import pytest

from robot_energy.foundation.errors import MeterAnswerError, MeterLinkError, MeterProfileError
from ros2_energy_monitor.base.credentials import Credentials
from ros2_energy_monitor.meters.kinds import METER_LINKS, load_profile
from ros2_energy_monitor.meters.link import Endpoint
from ros2_energy_monitor.meters.profile import FOLDER
from ros2_energy_monitor.meters.reading import Quantity

sys.path.append(str(Path(__file__).resolve().parent))
from documented_devices import (
    PAC2200,
    SHELLY_PRO_3EM,
    UMG,
    registers_of,
    shelly_em,
    shelly_status,
    tasmota_sensor,
)

SHIPPED = sorted(path.stem for path in FOLDER.glob("*.yaml"))


def link(profile, port, **options):
    kind, found = load_profile(str(profile))
    given = {"host": "127.0.0.1", "timeout": 60.0, **options}
    made = kind.make(found, Endpoint(port=port, **given))
    made.connect()
    return made


def words(form, number, swapped=False):
    """Registers of a number, by struct alone."""
    data = struct.pack(f">{form}", number)
    found = [int.from_bytes(data[i : i + 2], "big") for i in range(0, len(data), 2)]
    return found[::-1] if swapped else found


def laid(**blocks):
    """Registers by address: a4=[1, 2] is 1 at 4 and 2 at 5."""
    return {
        int(name[1:]) + i: value
        for name, values in blocks.items()
        for i, value in enumerate(values)
    }


def values(exchanges):
    return {one.quantity: [term.value for term in one.terms] for one in exchanges}


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_profiles_are_sound_and_say_where_they_are_from(name):
    kind, profile = load_profile(name)
    assert kind.name in METER_LINKS
    maker, *others = profile.sources
    assert maker
    assert any(source.startswith("second source: ") for source in others)
    assert "not on hardware" in profile.tried


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("link: modbus_tcp", "link: modbus"), ("modbus_tcp", "Write")),
        (("unit: Wh, wraps", "unit: W, wraps"), ("energy", "'W'")),
        (("type: float64", "type: float80"), ("type", "float64")),
        (("period: 1.0", "period: 0"), ("period", "greater than 0")),
        (("word_order: big", "wordorder: big"), ("wordorder", "word_order")),
    ],
)
def test_a_wrong_profile_is_refused_in_one_sentence(tmp_path, change, words):
    path = tmp_path / "mine.yaml"
    path.write_text((FOLDER / "siemens_pac2200.yaml").read_text().replace(*change))
    with pytest.raises(MeterProfileError) as caught:
        load_profile(str(path))
    for word in words:
        assert word in str(caught.value)


def test_an_unknown_profile_names_those_there_are():
    with pytest.raises(MeterProfileError, match=r"siemens_pac2200.*path of a YAML file"):
        load_profile("siemens")


def test_pac2200(modbus):
    registers, documented = registers_of(PAC2200)
    server = modbus(registers)
    meter = link("siemens_pac2200", server.port)
    energy, power = meter.read()
    tariffs = [documented["import tariff 1"], documented["import tariff 2"]]
    assert [term.value for term in energy.terms] == [3600 * tariff for tariff in tariffs]
    assert energy.terms[0].wraps_at == 3.6e15
    assert [term.value for term in power.terms] == [documented["total active power"]]
    assert server.requests == [(4, 801, 4), (4, 805, 4), (4, 65, 2)]  # by function 4
    assert energy.requested <= energy.answered <= power.requested <= power.answered
    meter.close()


@pytest.mark.parametrize(
    ("name", "table", "energy", "power", "swapped", "function"),
    [
        ("janitza_umg604", UMG, "consumed sum", "real power sum", False, 3),
        ("janitza_umg96rm", UMG, "consumed sum", "real power sum", False, 3),
        ("shelly_pro_3em", SHELLY_PRO_3EM, "total active energy", "total active power", True, 4),
    ],
)
def test_meters_with_floats(modbus, name, table, energy, power, swapped, function):
    registers, documented = registers_of(table, swapped)
    server = modbus(registers)
    meter = link(name, server.port)
    found = values(meter.read())
    assert found == {
        Quantity.ENERGY: [documented[energy] * 3600],
        Quantity.POWER: [documented[power]],
    }
    assert {request[0] for request in server.requests} == {function}
    meter.close()


OWN = """
schema_version: 1
label: my meter
sources: [none]
tried: not on hardware
link: modbus_tcp
table: holding
word_order: little
unit: 7
period: 1.0
energy:
  - {address: 10, type: uint32, unit: kWh, scale: 0.01, wraps_at: 42949672.96}
power:
  - {address: 14, type: int16, unit: W, scale: 10, invalid: [-32768]}
flags:
  - {address: 20, type: uint16, mask: 6, good: 2}
"""


def test_scale_type_unit_and_flags_of_an_own_profile(modbus, tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(OWN)
    server = modbus(laid(a10=[0x0001, 0x0002], a14=[0xFFFE], a20=[0xFFFB]), unit=7)
    meter = link(path, server.port)
    energy, power = meter.read()
    assert energy.terms[0].value == pytest.approx((2 * 65536 + 1) * 0.01 * 3.6e6)
    assert energy.terms[0].wraps_at == pytest.approx(2**32 * 0.01 * 3.6e6)
    assert power.terms[0].value == -20.0
    server.write(14, [0x8000])
    energy, power = meter.read()
    assert energy.terms[0].value > 0
    assert power.terms[0].value != power.terms[0].value  # NaN: no value
    server.write(20, [4])
    assert all(term.value != term.value for one in meter.read() for term in one.terms)
    meter.close()


WIDE = """
schema_version: 1
label: registers of 64 bits
sources: [none]
tried: not on hardware
link: modbus_tcp
table: holding
word_order: big
period: 1.0
energy:
  - {address: 0, type: uint64, unit: Wh, invalid: [18446744073709551614]}
  - {address: 4, type: int64, unit: Wh}
"""


@pytest.mark.parametrize(
    ("unsigned", "signed", "is_value"),
    [
        (7, -7, (True, True)),
        (2**64 - 1, 2**63 - 1, (False, False)),
        (2**64 - 2, -(2**63), (False, False)),
        (2**63, 2**62, (False, True)),
    ],
)
def test_codes_of_64_bits_that_mean_no_value(modbus, tmp_path, unsigned, signed, is_value):
    path = tmp_path / "wide.yaml"
    path.write_text(WIDE)
    server = modbus(laid(a0=words("Q", unsigned), a4=words("q", signed)))
    meter = link(path, server.port)
    found = values(meter.read())[Quantity.ENERGY]
    assert [value == value for value in found] == list(is_value)
    meter.close()


@pytest.mark.parametrize(
    ("change", "error"),
    [
        (("invalid: [18446744073709551614]", "invalid: [-1]"), "-1, which no uint64 is"),
        (("type: int64", "type: int32, invalid: [4294967295]"), "4294967295, which no int32 is"),
        (("address: 4", "address: 65533"), "int64 at 65533 ends beyond register 65535"),
        (("18446744073709551614", "18446744073709551616"), "beyond 64 bits"),
    ],
)
def test_codes_and_addresses_that_cannot_be(tmp_path, change, error):
    path = tmp_path / "wide.yaml"
    path.write_text(WIDE.replace(*change))
    with pytest.raises(MeterProfileError, match=error):
        load_profile(str(path))


@pytest.mark.parametrize("number", [1, 2, 4, 6, 11])
def test_modbus_exceptions_are_named_and_keep_the_connection(modbus, number):
    server = modbus(laid(a19068=[0, 0], a19026=[0, 0]))
    server.refusal = number
    meter = link("janitza_umg604", server.port)
    for _ in range(2):
        with pytest.raises(
            MeterAnswerError, match=rf"register 19068 with Modbus exception {number}"
        ):
            meter.read()
    server.refusal = None
    assert values(meter.read())[Quantity.POWER] == [0.0]
    meter.close()


def test_a_register_that_is_missing_and_another_unit(modbus):
    server = modbus(laid(a19026=[0, 0]))
    meter = link("janitza_umg604", server.port)
    with pytest.raises(MeterAnswerError, match="exception 2"):
        meter.read()
    meter.close()
    stranger = link("janitza_umg604", server.port, unit=9, timeout=0.3)
    with pytest.raises((MeterAnswerError, MeterLinkError)):
        stranger.read()
    stranger.close()


def test_no_answer_in_time_ends_the_connection(modbus, eventually):
    server = modbus(laid(a19068=[0, 0], a19026=[0, 0]))
    server.delay = 60.0
    meter = link("janitza_umg604", server.port, timeout=0.2)
    with pytest.raises(MeterLinkError, match=r"no answer for register 19068; expected one within"):
        meter.read()
    with pytest.raises(MeterLinkError, match="not connected"):  # not the late answer
        meter.read()
    server.delay = 0.0

    def read_again():
        try:
            meter.connect()
            return values(meter.read())
        except MeterLinkError:  # a busy machine answers as late
            return None

    assert eventually(read_again, "an answer")[Quantity.POWER] == [0.0]
    meter.close()


def test_nobody_there(modbus):
    server = modbus(laid(a0=[0]))
    server.stop()
    with pytest.raises(MeterLinkError, match="does not accept a connection"):
        link("janitza_umg604", server.port)


def chain(*models, base=40000):
    """A SunSpec device: the mark, model 1, the given ones, the end."""
    found = [0x5375, 0x6E53, 1, 66, *([0] * 66)]
    for number, data in models:
        found += [number, len(data), *data]
    return laid(**{f"a{base}": [*found, 0xFFFF, 0]})


def model_203(watt=-1234 & 0xFFFF, watt_scale=1, count=5_000_000, energy_scale=-1, events=0):
    data = [0] * 105
    data[16], data[20] = watt, watt_scale & 0xFFFF
    data[44:46] = words("I", count)
    data[52] = energy_scale & 0xFFFF
    data[103:105] = words("I", events)
    return 203, data


def test_sunspec_integers(modbus):
    server = modbus(chain(model_203()))
    meter = link("sunspec_meter", server.port)
    energy, power = meter.read()
    assert energy.terms[0].value == pytest.approx(5e6 * 0.1 * 3600)
    assert energy.terms[0].wraps_at == pytest.approx(2**32 * 0.1 * 3600)
    assert power.terms[0].value == -12340.0
    asked = len(server.requests)
    meter.read()
    assert server.requests[asked:] == [(3, 40072, 105)]  # the chain is walked once
    meter.close()


@pytest.mark.parametrize(
    ("model", "energy", "power"),
    [
        (model_203(watt=0x8000), True, False),
        (model_203(count=0), False, True),
        (model_203(watt_scale=-0x8000), True, False),
        (model_203(energy_scale=-0x8000), False, True),
        (model_203(events=1 << 7), False, False),
        (model_203(events=1 << 4), True, True),  # low power factor: still measured
    ],
)
def test_sunspec_values_that_are_none(modbus, model, energy, power):
    server = modbus(chain(model))
    meter = link("sunspec_meter", server.port)
    found = values(meter.read())
    assert [value == value for value in found[Quantity.ENERGY]] == [energy]
    assert [value == value for value in found[Quantity.POWER]] == [power]
    meter.close()


def test_sunspec_floats_at_another_address_behind_other_models(modbus):
    data = [0] * 124
    data[26:28], data[66:68] = words("f", 321.5), words("f", 7000.25)
    server = modbus(chain((160, [0] * 10), (213, data), base=0))
    meter = link("sunspec_meter", server.port)
    found = values(meter.read())
    assert found == {Quantity.ENERGY: [7000.25 * 3600], Quantity.POWER: [321.5]}
    meter.close()


def test_sunspec_without_a_meter_or_a_mark(modbus):
    server = modbus(chain((103, [0] * 50)))
    meter = link("sunspec_meter", server.port)
    with pytest.raises(MeterAnswerError, match=r"models 1, 103; expected meter number 1"):
        meter.read()
    meter.close()
    meter = link("sunspec_meter", modbus(laid(a40000=[1, 2])).port)
    with pytest.raises(MeterAnswerError, match="no SunSpec mark"):
        meter.read()
    meter.close()


def test_a_sunspec_chain_that_leaves_the_registers(modbus):
    registers = chain((103, [0] * 50))
    server = modbus(registers | {40070 + 1: 0xFFF0})  # the length of model 103
    meter = link("sunspec_meter", server.port)
    with pytest.raises(MeterAnswerError, match=r"models 1, 103; expected meter number 1"):
        meter.read()
    meter.close()


def test_shelly_over_http(http_meter):
    http_meter.says(json.dumps(shelly_status(power=512.25, energy=81.5)))
    meter = link("shelly_pro_3em_http", http_meter.port)
    found = values(meter.read())
    assert found == {Quantity.ENERGY: [81.5 * 3600], Quantity.POWER: [512.25]}
    assert http_meter.paths == ["/rpc/Shelly.GetStatus"]
    broken = shelly_status() | {"em:0": shelly_em(errors=("power_meter_failure",))}
    http_meter.says(json.dumps(broken))
    assert all(value != value for found in values(meter.read()).values() for value in found)
    meter.close()


@pytest.mark.parametrize(
    ("power", "total", "watts"),
    [(42, 3.12345, [42.0]), ([100, 200, 300], 3.12345, [100.0, 200.0, 300.0])],
)
def test_tasmota_over_http(http_meter, power, total, watts):
    http_meter.says(json.dumps({"StatusSNS": tasmota_sensor(power, total)}))
    meter = link("tasmota_http", http_meter.port)
    found = values(meter.read())
    assert found[Quantity.ENERGY] == [pytest.approx(3.12345 * 3.6e6)]
    assert found[Quantity.POWER] == watts
    meter.close()


def test_a_list_of_tariffs_is_not_added_up(http_meter):
    # As old releases of Tasmota send it: the total, and its two tariffs.
    http_meter.says(json.dumps({"StatusSNS": tasmota_sensor(total=[33.736, 11.717, 22.019])}))
    meter = link("tasmota_http", http_meter.port)
    with pytest.raises(MeterAnswerError, match=r"a list at StatusSNS.ENERGY.Total.*position, as 0"):
        meter.read()
    meter.close()


TEXTS = """
schema_version: 1
label: state of an automation
sources: [none]
tried: not on hardware
link: http_json
request: /state
auth: basic
period: 1.0
energy:
  - {path: [state], unit: kWh}
"""


@pytest.mark.parametrize(
    ("state", "kilowatt_hours"),
    [("230.5", 230.5), (" -1.5e3 ", -1500.0), ("7", 7.0), ('230,5', None), ("unavailable", None),
     ("1_0", None), ("0x10", None), ("", None), ("inf", None), ("१", None)],
)  # fmt: skip
def test_a_number_may_come_as_text(http_meter, tmp_path, state, kilowatt_hours):
    path = tmp_path / "text.yaml"
    path.write_text(TEXTS)
    http_meter.says(json.dumps({"state": state}))
    meter = link(path, http_meter.port)
    if kilowatt_hours is None:
        with pytest.raises(MeterAnswerError, match=r"text '.*' at state; expected a number, with"):
            meter.read()
    else:
        found = values(meter.read())[Quantity.ENERGY]
        assert found == [pytest.approx(kilowatt_hours * 3.6e6)]
    meter.close()


@pytest.mark.parametrize(
    ("body", "status", "error", "text"),
    [
        ("{}", 200, MeterAnswerError, "no number at emdata:0.total_act"),
        ("[1, 2", 200, MeterAnswerError, "no JSON"),
        ("[" * 100_000, 200, MeterAnswerError, "no JSON"),
        ("{}", 401, MeterAnswerError, "401 asks for credentials_file"),
        ("{}", 302, MeterAnswerError, "status 302"),
        ("{}", 500, MeterAnswerError, "status 500"),
        (" " * 2_000_000, 200, MeterLinkError, "does not end its answer"),
        (
            json.dumps({**shelly_status(), "em:0": {"total_act_power": {}}}),
            200, MeterAnswerError, "no number at em:0.total_act_power",
        ),
        (
            json.dumps({**shelly_status(), "em:0": {"total_act_power": "512,5"}}),
            200, MeterAnswerError, "the text '512,5' at em:0.total_act_power",
        ),
    ],
)  # fmt: skip
def test_other_answers_over_http(http_meter, body, status, error, text):
    http_meter.says(body, status, Location="http://127.0.0.1:1/")
    meter = link("shelly_pro_3em_http", http_meter.port)
    with pytest.raises(error, match=re.escape(text)):
        meter.read()
    meter.close()


def test_null_and_huge_numbers_are_no_readings(http_meter):
    text = json.dumps({"em:0": {"total_act_power": None}, "emdata:0": {"total_act": 0}})
    http_meter.says(text.replace(" 0}", " 1" + "0" * 400 + "}"))
    meter = link("shelly_pro_3em_http", http_meter.port)
    found = values(meter.read())
    assert found[Quantity.ENERGY] == [float("inf")]
    assert found[Quantity.POWER][0] != found[Quantity.POWER][0]
    meter.close()


def test_an_answer_that_drips_is_given_up(http_meter, eventually):
    def drip(request):
        request.send_response(200)
        request.send_header("Content-Length", "100000")
        request.end_headers()
        try:
            while True:
                request.wfile.write(b" ")
                request.wfile.flush()
                drips.wait(0.01)
        except OSError:
            ended.append(True)

    drips, ended = threading.Event(), []
    http_meter.answer = drip
    meter = link("shelly_pro_3em_http", http_meter.port, timeout=2.0)
    begin = time.monotonic()
    with pytest.raises(MeterLinkError, match="does not end its answer"):
        meter.read()
    assert time.monotonic() - begin < 100  # the whole answer takes a thousand seconds
    meter.close()
    eventually(lambda: ended, "the end of the connection")


def test_digest_with_sha256_as_shelly_asks_for(http_meter):
    def answer(request):
        sent = dict(re.findall(r'(\w+)="?([^",]+)"?', request.headers.get("Authorization", "")))
        if sent and sent["response"] == expected(sent):
            http_meter.says(json.dumps(shelly_status()))
            http_meter.answer(request)
            return
        request.send_response(401)
        request.send_header(
            "WWW-Authenticate",
            'Digest qop="auth", realm="shellypro3em", nonce="1699", algorithm=SHA-256',
        )
        request.send_header("Content-Length", "0")
        request.end_headers()

    def expected(sent):
        def digest(text):
            return hashlib.sha256(text.encode()).hexdigest()

        first = digest("admin:shellypro3em:secret")
        second = digest("GET:/rpc/Shelly.GetStatus")
        return digest(f"{first}:1699:{sent['nc']}:{sent['cnonce']}:auth:{second}")

    http_meter.answer = answer
    given = Credentials("admin", "secret")
    meter = link("shelly_pro_3em_http", http_meter.port, credentials=given)
    assert values(meter.read())[Quantity.POWER] == [512.25]
    meter.close()
    http_meter.answer = answer
    meter = link("shelly_pro_3em_http", http_meter.port, credentials=Credentials("admin", "wrong"))
    with pytest.raises(MeterAnswerError, match="status 401"):
        meter.read()
    meter.close()
