"""What every link to a meter does, whatever it speaks."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

from ros2_energy_monitor.base.credentials import Credentials
from ros2_energy_monitor.meters.reading import Exchange


@dataclass(frozen=True, kw_only=True)
class Endpoint:
    """Where the meter is and how to be let in.

    Attributes:
        host: Name or address of the meter, or of the MQTT broker.
        port: Port.
        timeout: Longest time for a connection and for an answer. [s]
        unit: Modbus unit (slave) identifier; None for that of the profile.
        device: Name of the meter in the topics of an MQTT broker.
        credentials: Name and password; None for none.
        tls: Whether the connection is encrypted.
        ca_file: Certificates of the authority that signed the server's; empty for the system's.
    """

    host: str
    port: int
    timeout: float
    unit: int | None = None
    device: str = ""
    credentials: Credentials | None = None
    tls: bool = False
    ca_file: str = ""


class MeterLink(ABC):
    """A connection to one meter, used by one thread."""

    @abstractmethod
    def connect(self) -> None:
        """Connect; what was connected before is given up.

        Raises:
            MeterLinkError: If the meter cannot be reached or does not let us in.
        """

    @abstractmethod
    def read(self) -> Sequence[Exchange]:
        """Ask for the numbers and return them; empty if the meter sent none in time.

        Raises:
            MeterLinkError: If the connection is lost.
            MeterAnswerError: If the meter refuses or answers something else.
        """

    @abstractmethod
    def close(self) -> None:
        """Disconnect; may be called twice."""

    @property
    def waits(self) -> bool:
        """Whether `read` waits for the meter by itself, so that nothing paces it."""
        return False
