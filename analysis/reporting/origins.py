"""Where the effects of a rig file came from, in words."""

from __future__ import annotations

from collections.abc import Sequence

from rigs.effects import Effect
from rigs.schema.effect import name_of

_MOST_NAMED = 5


def begins_with(effects: Sequence[Effect]) -> str:
    """How many effects a model begins with, which, and from where: `2 effects, written by hand: …`."""
    origins: dict[str, list[str]] = {}
    for effect in effects:
        origins.setdefault(_origin(effect), []).append(name_of(effect))
    count = f"{len(effects)} effect{'s' * (len(effects) != 1)}"
    return f"{count}, " + "; ".join(f"{origin}: {_listed(names)}" for origin, names in origins.items())


def _origin(effect: Effect) -> str:
    if effect.found is None:
        return "written by hand"
    return f"found on {effect.found.date} in {_listed(effect.found.runs)}"


def _listed(names: Sequence[str]) -> str:
    more = len(names) - _MOST_NAMED
    return ", ".join(names[:_MOST_NAMED]) + (f" and {more} more" if more > 0 else "")
