"""Signatures that list the options which several verbs share."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import TypeVar

Verb = TypeVar("Verb", bound=Callable[..., object])


def lists(options: type) -> Callable[[Verb], Verb]:
    """Return a decorator that shows the keys of a TypedDict in place of ``**options``.

    Args:
        options: The TypedDict, whose keys are None by default.
    """

    def shown(verb: Verb) -> Verb:
        signature = inspect.signature(verb)
        own = [p for p in signature.parameters.values() if p.kind is not p.VAR_KEYWORD]
        kinds = {  # as they are written
            name: getattr(kind, "__forward_arg__", kind)
            for name, kind in inspect.get_annotations(options).items()
        }
        shared = [
            inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=kind)
            for name, kind in kinds.items()
        ]
        verb.__dict__["__signature__"] = signature.replace(parameters=[*own, *shared])
        return verb

    return shown
