"""Signatures that list the options which several verbs share."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Collection
from difflib import get_close_matches
from typing import TypeVar, cast

from robot_energy.foundation.errors import OptionError
from robot_energy.foundation.kinds import LIKELY

Verb = TypeVar("Verb", bound=Callable[..., object])


def lists(options: type, without: Collection[str] = ()) -> Callable[[Verb], Verb]:
    """Return a decorator that shows the keys of a TypedDict in place of ``**options``.

    The verb refuses an option that it does not show, as an `OptionError`.

    Args:
        options: The TypedDict, whose keys are None by default.
        without: Keys that the verb does not have.
    """

    def shown(verb: Verb) -> Verb:
        signature = inspect.signature(verb)
        own = [p for p in signature.parameters.values() if p.kind is not p.VAR_KEYWORD]
        kinds = {  # as they are written
            name: getattr(kind, "__forward_arg__", kind)
            for name, kind in inspect.get_annotations(options).items()
            if name not in without
        }
        shared = [
            inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=kind)
            for name, kind in kinds.items()
        ]

        @functools.wraps(verb)
        def checked(*values: object, **given: object) -> object:
            check_options(verb.__name__, given, known)
            return verb(*values, **given)

        known = [parameter.name for parameter in (*own, *shared)]
        checked.__dict__["__signature__"] = signature.replace(parameters=[*own, *shared])
        return cast(Verb, checked)

    return shown


def check_options(verb: str, given: Collection[str], known: Collection[str]) -> None:
    """Refuse an option that a verb does not have, with the name that was probably meant."""
    for name in sorted({*given} - {*known}):
        near = get_close_matches(name, known, 1, LIKELY)
        raise OptionError(
            f"{verb} has no option '{name}'",
            f"'{near[0]}'?" if near else f"one of {', '.join(sorted(known))}",
        )
