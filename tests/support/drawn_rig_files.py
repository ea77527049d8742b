"""Random invalid rig files: valid files with one part removed or given in a wrong unit."""

from __future__ import annotations

import copy
import random
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import yaml

from rigs.arms import load_arm
from rigs.load import shipped

_M, _RAD = 1e-3, 0.017453292519943295
Key = str | int
Place = tuple[Key, ...]


@dataclass(frozen=True)
class DrawnFile:
    """A rig file with one mistake. place: path of the changed key; how: `missing`, `in metres` or `in radians`."""

    text: str
    place: Place
    how: str

    @property
    def title(self) -> str:
        """A description of the mistake."""
        return f"{'.'.join(map(str, self.place))} {self.how}"


def sound() -> list[dict[str, Any]]:
    """Return valid rig files: the shipped cells with a cube and sockets, and an arm of five axes with sockets."""
    files = []
    for path in shipped().values():
        data = yaml.safe_load(path.read_text(encoding="utf-8"))
        data["tests"] |= {"touch": _touch(), "iso9283": {}}
        files.append(data)
    robot = yaml.safe_load(load_arm("so-101").text)["robot"]
    return [*files, {"name": "so-101", "robot": robot, "tests": {"touch": _touch()}}]


def _touch() -> dict[str, Any]:
    between = {"between": ["A", "B"], "distance_mm": 50, "u_mm": 0.02}
    return {"sockets": ["A", "B"], "ball_mm": [30, 0, 90], "distances": [between]}


def drawn(seed: int) -> DrawnFile:
    """File for a seed. All keys of a valid file and all possible mistakes are equally likely."""
    rng = random.Random(seed)
    data = copy.deepcopy(rng.choice(sound()))
    place = rng.choice(sorted(_places(data), key=str))
    ways = ["missing"]
    if str(place[-1]).endswith(("_mm", "_mm_s")):
        ways.append("in metres")
    if str(place[-1]).endswith(("_deg", "_deg_s")):
        ways.append("in radians")
    how = rng.choice(ways)
    part: Any = data
    for key in place[:-1]:
        part = part[key]
    if how == "missing":
        del part[place[-1]]
    else:
        part[place[-1]] = _times(part[place[-1]], _M if how == "in metres" else _RAD)
    return DrawnFile(yaml.safe_dump(data, sort_keys=False), place, how)


def _places(data: Any, place: Place = ()) -> Iterator[Place]:
    """Path of every key."""
    pairs = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for key, value in pairs:
        if isinstance(data, dict):
            yield (*place, key)
        if not isinstance(value, list) or any(isinstance(entry, dict) for entry in value):
            yield from _places(value, (*place, key))


def _times(value: Any, factor: float) -> Any:
    if isinstance(value, dict):
        return {key: _times(entry, factor) for key, entry in value.items()}
    return [_times(entry, factor) for entry in value] if isinstance(value, list) else value * factor
