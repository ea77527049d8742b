"""What effects add to the whitened readings, as objects that can be recognised: what was computed from one is kept."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from analysis.kinematics.arm import Array
from rigs.effects import Effect
from rigs.schema.effect import PHASE, name_of

_KEPT = 4
"""Responses that are kept for each kind and name, at some 4 MB each with their products: about as many as the fits of
one round begin from."""


@dataclass(frozen=True, eq=False)
class Response:
    """What some terms add to the whitened readings: columns (N, k). Its products with other columns are kept for as
    long as it is."""

    columns: Array


@dataclass(frozen=True, eq=False)
class NearResponses:
    """The latest responses of effects, of which each stands for those of all effects near its own: derivatives and
    departures change little over a small part of a size."""

    _kept: dict[tuple[str, str], list[tuple[Effect, Response]]] = field(default_factory=dict, init=False, repr=False)

    def of(self, kind: str, effect: Effect, steps: Mapping[str, float], compute: Callable[[], Array]) -> Response:
        """Return the response of one kind of the latest effect whose parameters differ by at most `steps`, in their
        units, or compute its whitened columns (N, k). Parameters without a step do not differ."""
        kept = self._kept.setdefault((kind, name_of(effect)), [])
        found = next((one for one in kept if _is_near(one[0], effect, steps)), None)
        if found is None:
            found = (effect, Response(compute()))
        else:
            kept.remove(found)
        kept.insert(0, found)
        del kept[_KEPT:]
        return found[1]


def _is_near(one: Effect, other: Effect, steps: Mapping[str, float]) -> bool:
    """Return whether two effects of one name differ by at most `steps` in each parameter."""
    before, after = (dict[str, Any](effect) for effect in (one, other))
    return all(
        value == after[name] or (name in steps and _apart(name, value, after[name]) <= steps[name])
        for name, value in before.items()
        if name != "found"
    )


def _apart(name: str, one: float, other: float) -> float:
    """Return the difference of two values of a parameter, of phases the smaller way round."""
    apart = abs(one - other)
    return min(apart % 360, -apart % 360) if name == PHASE else apart
