"""Exceptions of the library: one base class, leaves that also inherit the fitting builtin.

Every message is one sentence that says what was found, what was expected and what to do.
"""

from __future__ import annotations

from robot_energy.foundation.shown_text import MAX_LINE, shown


class RobotEnergyError(Exception):
    """Base class of every error this library raises on purpose.

    Args:
        found: What was met, with its place (file, key, topic).
        expected: What would have been right; may be empty when ``found`` says it.
        remedy: What the user can do about it; may be empty.
    """

    def __init__(self, found: str, expected: str = "", remedy: str = "") -> None:
        # Names from outside are quoted in all three; nothing of them may act on a terminal.
        found, expected, remedy = (shown(part, MAX_LINE) for part in (found, expected, remedy))
        self.found = found
        self.expected = expected
        self.remedy = remedy
        text = _ended(f"{found}; expected {expected}" if expected else found)
        if remedy:
            word = remedy.split(maxsplit=1)[0]  # a command or a key is quoted as it is
            text += f" {remedy[0].upper() if word.isalpha() else remedy[0]}{_ended(remedy[1:])}"
        super().__init__(text)

    def __str__(self) -> str:
        return str(self.args[0])  # not in quotes, where it is a KeyError too


def _ended(sentence: str) -> str:
    return sentence if sentence.endswith("?") else f"{sentence.rstrip('.')}."


class KindError(RobotEnergyError, KeyError):
    """A kind of drive model, friction law, meter ... is unknown, registered twice or incomplete."""


class ModelFileError(RobotEnergyError, ValueError):
    """A model file is missing, malformed or of another schema version."""


class UrdfAwaitedError(ModelFileError):
    """A model file leaves its URDF to a topic, and none was given."""

    def __init__(self, source: str, topic: str) -> None:
        self.topic = topic
        super().__init__(
            f"{source} takes its URDF from the topic '{topic}', which only a node can read",
            "a URDF",
            "name a file as urdf.path or embed the text as urdf.xml",
        )


class RobotDescriptionError(RobotEnergyError, ValueError):
    """A URDF cannot be used: unreadable, without inertias, unsupported joints."""


class UnknownJointError(RobotEnergyError, KeyError):
    """A joint name is not in the model, or a joint of the model is nowhere in the data."""


class PayloadError(RobotEnergyError, ValueError):
    """A payload cannot exist: negative mass, or an inertia that no body has."""


class DatasetError(RobotEnergyError, ValueError):
    """A dataset of a fleet, or the list of its bags, cannot be used."""


class ShapeError(RobotEnergyError, ValueError):
    """An array has the wrong shape."""


def check_shape(name: str, found: tuple[int, ...], expected: tuple[int, ...]) -> None:
    if found != expected:
        raise ShapeError(f"{name} has shape {found}", f"{expected}")


class BagError(RobotEnergyError, ValueError):
    """A bag cannot be opened, read or written."""


class MissingTopicError(RobotEnergyError, LookupError):
    """A bag lacks a topic, or has it with another type."""


class MessageTypeError(RobotEnergyError, TypeError):
    """A message type is unknown or lacks a field."""


class ParameterError(RobotEnergyError, ValueError):
    """A parameter of a node or input is missing, of a wrong type, out of range, or does not fit."""


class OptionError(RobotEnergyError, TypeError):
    """A function has no option of that name."""


class CredentialsError(RobotEnergyError, ValueError):
    """A file of secrets is missing, open to others than its owner, or malformed."""


class MeterProfileError(RobotEnergyError, ValueError):
    """The profile of a network meter is missing or malformed."""


class MeterLinkError(RobotEnergyError, OSError):
    """A network meter cannot be reached, or its connection is lost."""


class MeterAnswerError(RobotEnergyError, ValueError):
    """A network meter refuses a request, or answers with something else."""


class LayoutError(RobotEnergyError, ValueError):
    """Layouts of viewers cannot be made of the message definitions, or not be written."""


class ExporterError(RobotEnergyError, ValueError):
    """An exporter cannot be set up as asked."""


class LogFormatError(RobotEnergyError, ValueError):
    """A log (CSV) or its mapping cannot be imported."""


class MotionError(RobotEnergyError, ValueError):
    """A motion or program cannot be executed: limits, shapes, times."""


class RigError(RobotEnergyError, ValueError):
    """The virtual test rig cannot be set up or stepped as asked."""


class RegisterError(RobotEnergyError, ValueError):
    """A reset or an interval is refused: no reason, unknown or repeated name, too many."""


class StateFileError(RobotEnergyError, OSError):
    """State files cannot be read, written or locked, or hold something else."""


class HistoryError(RobotEnergyError, OSError):
    """A history cannot be read, written or locked, or a tariff of it not be used."""


class ReportError(RobotEnergyError, ValueError):
    """A report or figure cannot be made or written."""


class NotIdentifiableError(RobotEnergyError, ValueError):
    """The data do not excite a parameter that was asked for."""


class ImplausibleIdentificationError(RobotEnergyError, ValueError):
    """What was identified contradicts physics or the URDF grossly, so that it is not written."""


class ColumnError(RobotEnergyError, KeyError):
    """A table has no column of that name."""


class MissingExtraError(RobotEnergyError, ImportError):
    """A library is not installed that only some parts need; an extra of the distribution has it."""


class PageError(RobotEnergyError, ValueError):
    """The energy page cannot be served, set up or saved as asked."""
