"""Mutated requests to the control socket: each gets an answer, and only a sound one reaches the daemon."""

from __future__ import annotations

import json
from collections.abc import Callable
from random import Random
from typing import Any

from daq.service.control import reply

# private _label: the daemon's reading of a request, without a daemon
from daq.service.daemon import _label
from tests.trials.fuzz.mutation import mutated

_GOOD = [
    {"command": "status"},
    {"command": "record_stop"},
    {"command": "record_start", "name": "lap", "test": "yaw", "direction": "acw", "operator": "anna"},
    {"command": "record_start", "name": "r1", "test": "radial", "direction": None},
]
_VALUES: list[Any] = [
    None,
    1,
    -1,
    1.5,
    True,
    "",
    "a/b",
    "x" * 300,
    [],
    {},
    ["yaw"],
    {"a": 1},
    "\ud800",
    "\n",
    float("inf"),
]
Control = Callable[[Random], int]


def control() -> dict[str, list[Control]]:
    """Functions that send input to the socket."""
    return {"control": [_bytes, _values]}


def _bytes(dice: Random) -> int:
    return _ask(mutated(dice, [json.dumps(good).encode() for good in _GOOD]))


def _values(dice: Random) -> int:
    request = dict(dice.choice(_GOOD))
    for _ in range(dice.randrange(3)):
        request[
            dice.choice(
                ["command", "name", "test", "direction", "operator", "self", "", "\ud800", "k" * 3000, "model_config"]
            )
        ] = dice.choice(_VALUES)
    return _ask(json.dumps(request).encode())


def _ask(line: bytes) -> int:
    answer = reply(line, _answer)
    assert isinstance(answer["ok"], bool) and b"\n" not in json.dumps(answer).encode()
    if not answer["ok"]:
        told = f"{answer['where']}: {answer['what']}; {answer['remedy']}"
        assert len(told) < 1000 and "\n" not in told, told
    return 1


def _answer(request: dict[str, Any]) -> dict[str, Any]:
    return {"run": _label(request).name} if request.get("command") == "record_start" else {}
