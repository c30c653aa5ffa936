# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Meters that speak Modbus TCP."""

from __future__ import annotations

import logging
import math
import struct
import time
from collections.abc import Sequence
from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from robot_energy.foundation.errors import MeterAnswerError, MeterLinkError, MeterProfileError
from ros2_energy_monitor.base.optional_packages import require
from ros2_energy_monitor.meters.link import AnswerBound, Endpoint, MeterLink
from ros2_energy_monitor.meters.profile import MeterProfile, NumberEntry, ProfileEntry
from ros2_energy_monitor.meters.reading import Exchange, MeterTerm, Quantity

FUNCTIONS = {"holding": ("read_holding_registers", 3), "input": ("read_input_registers", 4)}
REGISTERS = 0x10000  # of a table
# No counter reaches these, and no power: with 64 bits they always mean that there is no value.
NO_VALUES = {
    "int64": (-(2**63), 2**63 - 1),
    "uint64": (2**64 - 1, 2**63 - 1, 2**63),
}

NumberType = Literal["int16", "uint16", "int32", "uint32", "int64", "uint64", "float32", "float64"]
WordOrder = Literal["big", "little"]
Address = Annotated[int, Field(ge=0, le=65535)]


class ModbusNumber(NumberEntry):
    """A number in registers.

    Attributes:
        address: Protocol address of its first register, counted from 0.
        invalid: Numbers as read that mean: no value; the greatest and least of 64 bits always do.
    """

    address: Address
    type: NumberType
    invalid: tuple[int, ...] = ()

    @model_validator(mode="after")
    def _check_range(self) -> Self:
        if self.address + length(self.type) > REGISTERS:
            raise ValueError(f"{self.type} at {self.address} ends beyond register 65535")
        if "int" in self.type:
            bits = int(self.type[-2:])
            low, high = (
                (0, 2**bits) if self.type[0] == "u" else (-(2 ** (bits - 1)), 2 ** (bits - 1))
            )
            for code in self.invalid:
                if not low <= code < high:
                    raise ValueError(
                        f"invalid is {code}, which no {self.type} is; expected {low} to {high - 1}"
                    )
        return self

    def is_value(self, found: float) -> bool:
        """Return whether a number as read is a value.

        Args:
            found: The number. [any]
        """
        return found not in self.invalid and found not in NO_VALUES.get(self.type, ())


class ModbusFlag(ProfileEntry):
    """Registers that say whether the meter trusts its numbers.

    Attributes:
        good: What these bits are while the numbers are valid.
    """

    address: Address
    type: Literal["uint16", "uint32"]
    mask: int
    good: int = 0


class ModbusProfile(MeterProfile[ModbusNumber]):
    """Profile of a meter whose register numbers are known.

    Attributes:
        table: Which registers: holding (function 3) or input (function 4).
        word_order: Which register of a number comes first: that of its high or its low bits.
        flags: Where the meter says that its numbers are invalid.
    """

    port: Annotated[int, Field(ge=1, le=65535)] = 502
    unit: Annotated[int, Field(ge=0, le=255)] = 1
    table: Literal["holding", "input"]
    word_order: WordOrder
    flags: tuple[ModbusFlag, ...] = ()


def length(kind: NumberType) -> int:
    return int(kind[-2:]) // 16


class RegisterLink(MeterLink):
    """Reads ``holding`` or ``input`` registers over one TCP connection."""

    def __init__(self, endpoint: Endpoint, unit: int, table: str) -> None:
        self._client_module = require(
            "pymodbus.client", "pymodbus", "this meter", MeterProfileError
        )
        self._errors = require("pymodbus.exceptions", "pymodbus", "this meter", MeterProfileError)
        logging.getLogger("pymodbus").setLevel(logging.CRITICAL)  # diagnostics say it
        self._endpoint, self._table = endpoint, table
        self._unit = unit if endpoint.unit is None else endpoint.unit
        self._client = None
        self.bound = AnswerBound(self.where, endpoint.timeout)

    @property
    def where(self) -> str:
        """The meter, for error texts."""
        return f"the Modbus meter at {self._endpoint.host}:{self._endpoint.port}"

    def connect(self) -> None:
        self.close()
        client = self._client_module.ModbusTcpClient(
            self._endpoint.host,
            port=self._endpoint.port,
            timeout=self._endpoint.timeout,
            retries=0,
        )
        if not client.connect():
            raise MeterLinkError(
                f"{self.where} does not accept a connection",
                remedy="check host, port and whether its Modbus TCP server is switched on",
            )
        receive = client.recv

        def bounded(size: int | None) -> bytes:
            client.comm_params.timeout_connect = self.bound.left
            data = receive(size)
            self.bound.take(len(data))
            return data

        client.recv = bounded
        self._client = client

    def close(self) -> None:
        if self._client is not None:
            self._client.close()
            self._client = None

    def registers(self, address: int, count: int) -> list[int]:
        if self._client is None:
            raise MeterLinkError(f"{self.where} is not connected", "connect first")
        if address + count > REGISTERS:
            raise MeterAnswerError(
                f"{self.where} is asked for the registers {address} to {address + count - 1}",
                f"0 to {REGISTERS - 1}",
            )
        name, function = FUNCTIONS[self._table]
        answer = self._answer(name, address, count)
        if answer.isError():
            raise MeterAnswerError(
                f"{self.where} refuses {self._table} register {address} with Modbus exception "
                f"{answer.exception_code}",
                f"its value from unit {self._unit}",
                "check unit, profile and firmware",
            )
        if answer.function_code != function:
            self.close()
            raise MeterLinkError(
                f"{self.where} answers function {function} with function {answer.function_code}",
                "the same",
            )
        if len(answer.registers) != count:
            raise MeterAnswerError(
                f"{self.where} answers with {len(answer.registers)} registers at {address}",
                str(count),
            )
        return list(answer.registers)

    def _answer(self, name: str, address: int, count: int) -> Any:
        """Ask; an error ends the connection, so that no late answer is taken for the next one."""
        try:
            return getattr(self._client, name)(address, count=count, device_id=self._unit)
        except MeterLinkError:
            self.close()
            raise
        except (self._errors.ModbusException, OSError) as error:
            self.close()
            raise MeterLinkError(
                f"{self.where} gave no answer for register {address}",
                f"one within {self._endpoint.timeout:g} s",
            ) from error
        except (ValueError, IndexError, struct.error) as error:
            self.close()
            raise MeterLinkError(
                f"{self.where} sent no Modbus for register {address}", "an answer"
            ) from error


class ModbusLink(RegisterLink):
    """Reads the registers that a profile lists, each quantity in requests of its own."""

    def __init__(self, profile: ModbusProfile, endpoint: Endpoint) -> None:
        self._profile = profile
        super().__init__(endpoint, profile.unit, profile.table)

    def read(self) -> Sequence[Exchange]:
        """Read flags, energy and power in this order."""
        self.bound.begin()
        valid = all(
            int(self._raw(flag.address, flag.type)) & flag.mask == flag.good
            for flag in self._profile.flags
        )
        quantities = self._profile.quantities.items()
        return [self._exchange(what, numbers, valid) for what, numbers in quantities]

    def _exchange(
        self, quantity: Quantity, numbers: Sequence[ModbusNumber], valid: bool
    ) -> Exchange:
        requested = time.monotonic()
        values = [self._raw(number.address, number.type) for number in numbers]
        answered = time.monotonic()
        terms = tuple(
            MeterTerm(
                value * number.factor if valid and number.is_value(value) else math.nan,
                number.wraps_at_joule,
            )
            for value, number in zip(values, numbers, strict=True)
        )
        return Exchange(quantity, terms, requested, answered)

    def _raw(self, address: int, kind: NumberType) -> float:
        client = self._client_module.ModbusTcpClient
        registers = self.registers(address, length(kind))
        of_kind = client.DATATYPE[kind.upper()]
        return client.convert_from_registers(registers, of_kind, self._profile.word_order)
