# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""What devices answer by the documents of their makers, whatever our profiles read of it.

Every number has a value of its own, so that a wrong key, address, type or word order shows.

Sources: Shelly Gen2 API documentation (EM, EMData, EM1Data, Modbus); Tasmota documentation
(Status 10, power monitoring) and its energy driver; Janitza, Modbus address lists of UMG 604 and
UMG 96RM, frequently required readings; Siemens, Equipment Manual PAC2200, appendix A.
"""

from __future__ import annotations

import struct

PHASES = "abc"
WORDS = {"f": 2, "d": 4, "I": 2}

# Name, address of the first register counted from 0, and its type as of struct.
UMG = [
    *((f"voltage {name}", 19000 + 2 * i, "f") for i, name in enumerate(("1", "2", "3"))),
    *((f"voltage {name}", 19006 + 2 * i, "f") for i, name in enumerate(("12", "23", "31"))),
    *((f"current {name}", 19012 + 2 * i, "f") for i, name in enumerate(("1", "2", "3", "N"))),
    *((f"real power {name}", 19020 + 2 * i, "f") for i, name in enumerate(("1", "2", "3", "sum"))),
    *((f"apparent {name}", 19028 + 2 * i, "f") for i, name in enumerate(("1", "2", "3", "sum"))),
    *((f"reactive {name}", 19036 + 2 * i, "f") for i, name in enumerate(("1", "2", "3", "sum"))),
    *((f"cos phi {name}", 19044 + 2 * i, "f") for i, name in enumerate(("1", "2", "3"))),
    ("frequency", 19050, "f"),
    ("rotation field", 19052, "f"),
    *((f"real energy {name}", 19054 + 2 * i, "f") for i, name in enumerate(("1", "2", "3", "sum"))),
    *((f"consumed {name}", 19062 + 2 * i, "f") for i, name in enumerate(("1", "2", "3", "sum"))),
    *((f"delivered {name}", 19070 + 2 * i, "f") for i, name in enumerate(("1", "2", "3", "sum"))),
]
PAC2200 = [
    *((f"voltage {i}", 1 + 2 * i, "f") for i in range(6)),
    *((f"current {i}", 13 + 2 * i, "f") for i in range(3)),
    *((f"apparent power {i}", 19 + 2 * i, "f") for i in range(3)),
    *((f"active power {i}", 25 + 2 * i, "f") for i in range(3)),
    *((f"reactive power {i}", 31 + 2 * i, "f") for i in range(3)),
    ("total apparent power", 63, "f"),
    ("total active power", 65, "f"),
    ("total reactive power", 67, "f"),
    ("import tariff 1", 801, "d"),
    ("import tariff 2", 805, "d"),
    ("export tariff 1", 809, "d"),
    ("export tariff 2", 813, "d"),
]
SHELLY_PRO_3EM = [  # 31000 there is 1000 here; the low word comes first
    ("EM time", 1000, "I"),
    ("total current", 1011, "f"),
    ("total active power", 1013, "f"),
    ("total apparent power", 1015, "f"),
    ("EMData time", 1160, "I"),
    ("total active energy", 1162, "f"),
    ("total active returned energy", 1164, "f"),
]


def registers_of(
    table: list[tuple[str, int, str]], low_word_first: bool = False
) -> tuple[dict[int, int], dict[str, float]]:
    """Registers of a device, and what its numbers are by name."""
    registers: dict[int, int] = {}
    numbers: dict[str, float] = {}
    for index, (name, address, form) in enumerate(table):
        number = 1000 + index if form == "I" else 1000.5 + index
        data = struct.pack(f">{form}", number)
        words = struct.unpack(f">{len(data) // 2}H", data)
        ordered = words[::-1] if low_word_first else words
        registers |= {address + i: word for i, word in enumerate(ordered)}
        numbers[name] = number
    return registers, numbers


def shelly_em(power: float = 512.25, errors: tuple[str, ...] = ()) -> dict[str, object]:
    """Status of the component EM."""
    found: dict[str, object] = {"id": 0}
    for at, phase in enumerate(PHASES, 1):
        found |= {
            f"{phase}_current": 0.1 * at,
            f"{phase}_voltage": 230.0 + at,
            f"{phase}_act_power": 10.0 * at,
            f"{phase}_aprt_power": 11.0 * at,
            f"{phase}_pf": 0.9,
            f"{phase}_freq": 50.0,
        }
    found |= {"n_current": None, "total_current": 0.6}
    found |= {"total_act_power": power, "total_aprt_power": 600.5, "user_calibrated_phase": []}
    return found | ({"errors": list(errors)} if errors else {})


def shelly_emdata(energy: float = 81.5) -> dict[str, object]:
    """Status of the component EMData: `total_act_energy` is of EM1Data alone."""
    found: dict[str, object] = {"id": 0}
    for at, phase in enumerate(PHASES, 1):
        found |= {f"{phase}_total_act_energy": 20.0 * at, f"{phase}_total_act_ret_energy": at}
    return found | {"total_act": energy, "total_act_ret": 7.5}


def shelly_status(power: float = 512.25, energy: float = 81.5) -> dict[str, object]:
    """Answer to Shelly.GetStatus, the profile of the device being triphase."""
    return {
        "ble": {},
        "cloud": {"connected": False},
        "em:0": shelly_em(power, ("phase_sequence",)),
        "emdata:0": shelly_emdata(energy),
        "sys": {"mac": "A8032ABE54DC", "unixtime": 1_700_000_000},
        "temperature:0": {"id": 0, "tC": 46.4, "tF": 115.4},
    }


def tasmota_sensor(
    power: object = 42, total: object = 3.12345, time: str = "2026-01-01T00:00:00"
) -> dict[str, object]:
    """Payload of tele/TOPIC/SENSOR; several phases have a list of powers."""
    energy = {
        "TotalStartTime": "2025-05-28T19:39:56",
        "Total": total,
        "Yesterday": 0.125,
        "Today": 0.062,
        "Power": power,
        "ApparentPower": 50,
        "ReactivePower": 27,
        "Factor": 0.84,
        "Voltage": 230,
        "Current": 0.217,
    }
    return {"Time": time, "ENERGY": energy}
