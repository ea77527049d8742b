"""The JSON answer of `rig diagnose` as the scorer reads it: tolerant of what is missing, wherever a key stands."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

CONDITIONS = (
    "named",
    "ambiguous",
    "out_of_range",
    "outside_library",
    "undecided",
    "uncalibrated",
    "nothing_unusual",
    "not_testable_here",
)
_NAMING = ("named", "ambiguous")


@dataclass(frozen=True)
class Named:
    """One effect of an answer: its name as the truth writes it, its rivals' names, parameters as (value, sd or nan);
    posterior: nan where none is told; stands: True where nothing is said of it; worth_um: nan if unknown."""

    name: str
    rivals: tuple[str, ...]
    parameters: Mapping[str, tuple[float, float]]
    posterior: float = math.nan
    stands: bool = True
    worth_um: float = math.nan


@dataclass(frozen=True)
class Answer:
    """Answer of a diagnosis.

    condition: one of CONDITIONS, another stated condition, or `none`. effects: confirmed effects, if the condition
    names
    any. listed: effects of any condition. left: share of the hidden error that remains with them, by place, computed
    from
    the truth. seconds: duration, nan if unknown. remainder_um: stated unexplained error, nan if not stated.
    """

    condition: str
    effects: tuple[Named, ...]
    left: Mapping[str, float]
    seconds: float
    listed: tuple[Named, ...] = ()
    remainder_um: float = math.nan


def answer_of(data: Mapping[str, Any] | None) -> Answer:
    """Return the parsed answer; None, an error or a broken answer gives `none`."""
    if not isinstance(data, Mapping) or not isinstance(data.get("condition"), str):
        return Answer("none", (), {}, math.nan)
    condition = data["condition"]
    left = data.get("left_by_truth") if isinstance(data.get("left_by_truth"), Mapping) else {}
    after = _number(_at(data, "gap", "train", "after"))
    listed = tuple(_named(one, after) for one in _list(data.get("effects")) if isinstance(one, Mapping))
    known = {str(place): _number(share) for place, share in left.items() if math.isfinite(_number(share))}
    effects = tuple(one for one in listed if one.stands) if condition in _NAMING else ()
    return Answer(
        condition, effects, known, _number(data.get("seconds")), listed, _number(_at(data, "remainder", "um"))
    )


def name_in(effect: Mapping[str, Any]) -> str:
    """`backlash 1`, `link_geometry 5.a`, `wrist_coupling 4>5`, `gauge_scale g1`, `time_lag`."""
    what = str(effect.get("effect", "?"))
    if what == "link_geometry":
        return f"{what} {_key(effect, 'axis')}.{_key(effect, 'field')}"
    if what == "wrist_coupling":
        return f"{what} {_key(effect, 'from_axis')}>{_key(effect, 'to_axis')}"
    if what.startswith("gauge_") and what != "gauge_baseline":
        return f"{what} {_key(effect, 'gauge')}"
    axis = _key(effect, "axis")
    return what if axis == "?" else f"{what} {axis}"


def _named(effect: Mapping[str, Any], after_um: float) -> Named:
    rivals = tuple(name_in(rival) for rival in _list(effect.get("rivals")) if isinstance(rival, Mapping))
    parameters = effect.get("parameters")
    found = {}
    for key, value in (parameters if isinstance(parameters, Mapping) else {}).items():
        given = value if isinstance(value, Mapping) else {"value": value}
        found[key] = (_number(given.get("value")), _number(given.get("sd")))
    # Where an answer does not say what a name is worth, its gap with and without the name does.
    paid = _number(effect.get("gap_without_um")) ** 2 - after_um**2
    worth = math.sqrt(max(paid, 0.0)) if math.isfinite(paid) else math.nan
    return Named(
        name_in(effect),
        rivals,
        found,
        _number(effect.get("posterior")),
        effect.get("stands") is not False,
        _number(effect.get("worth_um", worth)),
    )


def _at(data: Mapping[str, Any], *keys: str) -> Any:
    """Return the value of nested keys; None if a key is missing."""
    found: Any = data
    for key in keys:
        found = found.get(key) if isinstance(found, Mapping) else None
    return found


def _key(effect: Mapping[str, Any], key: str) -> str:
    parameters = effect.get("parameters")
    value = effect.get(key, parameters.get(key) if isinstance(parameters, Mapping) else None)
    value = value.get("value") if isinstance(value, Mapping) else value
    if isinstance(value, float) and value.is_integer():
        value = int(value)
    return "?" if value is None else str(value)


def _number(value: Any) -> float:
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else math.nan


def _list(value: Any) -> list[Any]:
    return value if isinstance(value, list) else []
