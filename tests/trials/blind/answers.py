"""The JSON answer of `rig diagnose` as the scorer reads it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Named:
    """An effect of an answer; odds are nan if they are not stated, parameters are (value, sd or nan)."""

    name: str
    rivals: tuple[str, ...] = ()
    parameters: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    posterior: float = math.nan
    stands: bool = True


@dataclass(frozen=True)
class Answer:
    """Answer of a diagnosis; its condition is `none` if it is missing or ended in an error."""

    condition: str = "none"
    listed: tuple[Named, ...] = ()
    seconds: float = math.nan


def answer_of(data: Mapping[str, Any] | None) -> Answer:
    if data is None or "condition" not in data:
        return Answer()
    listed = tuple(map(_named, data["effects"]))
    return Answer(data["condition"], listed, data.get("seconds", math.nan))


def _named(effect: Mapping[str, Any]) -> Named:
    sizes = {
        key: (one["value"], math.nan if one["sd"] is None else one["sd"]) for key, one in effect["parameters"].items()
    }
    odds = math.nan if effect.get("posterior") is None else effect["posterior"]
    rivals = tuple(rival["name"] for rival in effect.get("rivals") or ())
    return Named(effect["name"], rivals, sizes, odds, effect.get("stands", True))
