"""A world drawn from its seed: the cell, its possible faults, and the duration."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from random import Random
from typing import Any

import yaml

from rigs.load import SHIPPED
from rigs.schema.feedback import carries_signal
from tests.support.drivers import FEEDBACKS, GAUGES, joints, modbus


class Blow(StrEnum):
    """Kinds of faults. Each world draws a few kinds that may happen in it."""

    CABLE = "cable pulled"
    RESET = "connection reset"
    LATE = "late answer"
    CUT = "message cut off"
    JUNK = "junk in a message"
    HEAD_OFF = "gauge in error"
    CLOCK = "clock set"
    SLEEP = "host slept"
    FULL = "disk full"
    QUOTA = "quota met"
    FAILING = "disk fails"
    SLOW = "disk slow"
    FLOOD = "flood of clients"
    KILL = "killed"
    POWER_CUT = "power cut"
    RESTART = "restarted in order"
    PROGRAM = "program of the robot"
    RETENTION = "days pass"


_SEVERAL = 0.35
"""Chance of each kind in a world."""
_GAUGE_TIMEOUTS_S = (0.2, 0.5)
_ROBOT_TIMEOUT_S = 1.0


@dataclass(frozen=True)
class World:
    """seconds: how long it is watched; pause_s: between two blows, at most; small: whether rooms are small, so that
    they overflow; chunk_s: age at which a chunk is closed."""

    seed: int
    names: tuple[str, ...]
    text: str
    seconds: float
    pause_s: float
    blows: tuple[Blow, ...]
    small: bool
    chunk_s: float

    @property
    def is_long(self) -> bool:
        """True if the world lasts for hours."""
        return self.seconds > 3600

    def __str__(self) -> str:
        rooms = ", small rooms" if self.small else ""
        blows = ", ".join(self.blows) or "nothing"
        return f"{' and '.join(self.names)} for {self.seconds:.0f} s{rooms}: {blows}"


def world(seed: int) -> World:
    dice = Random(seed)
    is_long = dice.random() < 1 / 8
    data: dict[str, Any] = yaml.safe_load((SHIPPED / "ur10e-cell.yaml").read_text())
    data["name"] = "storm"
    names, data["gauges"] = _gauges(dice, is_long)
    name, data["feedback"], has_signal = _robot(dice, is_long)
    blows = [blow for blow in Blow if dice.random() < _SEVERAL]
    if not has_signal and Blow.PROGRAM in blows:
        blows.remove(Blow.PROGRAM)
    if Blow.POWER_CUT in blows or not is_long:
        blows = [blow for blow in blows if blow is not Blow.RETENTION]
    if is_long:  # the log of a disk that forgets holds every byte
        blows = [blow for blow in blows if blow is not Blow.POWER_CUT]
    if has_signal:
        rule = {"when": {"signal": 1}, "still_s": 1.0} | what_to_record(len(data["gauges"]))
        data["automatic"] = {"rules": [rule]}
    if Blow.RETENTION in blows:
        data["retention"] = {"days": 2}
    return World(
        seed,
        (*names, name),
        yaml.safe_dump(data),
        seconds=dice.uniform(1.5, 4) * 3600 if is_long else dice.uniform(15, 60),
        pause_s=dice.uniform(600, 3000) if is_long else dice.uniform(1, 8),
        blows=tuple(blows),
        small=not is_long and dice.random() < 0.5,
        chunk_s=600.0 if is_long else dice.uniform(0.5, 20.0),
    )


def _gauges(dice: Random, is_long: bool) -> tuple[list[str], dict[str, Any]]:
    """One to three gauges of any interface, each on a line of its own or two on one."""
    chosen: list[tuple[str, list[Any]]] = []
    if is_long:
        place = {"port": "tcp://127.0.0.1:502", "rate_hz": 0.5, "timeout_s": 2.0}
        chosen = [("modbus tcp, seldom", [modbus(**place)])]
    else:
        for _ in range(dice.choice((1, 2, 2, 3))):
            name, gauges, _ = dice.choice(GAUGES)
            chosen.append((name, list(gauges)))
    data: dict[str, Any] = {}
    for place, (_, gauges) in enumerate(chosen):
        timeout_s = 2.0 if is_long else dice.choice(_GAUGE_TIMEOUTS_S)
        line = None if is_long else dice.choice(("9600 {}", "19200 {}", "38400 {}"))
        for gauge in gauges:
            one = gauge.model_dump(mode="json", exclude_none=True)
            one["port"] = f"tcp://127.0.0.1:{502 + place}" if "tcp" in one["port"] else f"/dev/ttyUSB{place}"
            one |= {"offset_mm": 25 - 50 * len(data), "timeout_s": timeout_s, "timing": {"latch": "unknown"}}
            if one.get("mode") == "continuous" or one["interface"] == "micro_epsilon_ild1420":
                one["timing"] = {"latch": "streamed", "cycle_ms": dice.choice((20, 50, 100))}
            if one["interface"] == "micro_epsilon_ild1420":
                one["zero_mm"] = 0.0
            elif line:
                one["line"] = line.format(str(one["line"]).partition(" ")[2])
            if not is_long and "rate_hz" in one:
                one["rate_hz"] = dice.choice((5, 20, 50))
            data[f"g{len(data) + 1}"] = one
    return [name for name, _ in chosen], data


def _robot(dice: Random, is_long: bool) -> tuple[str, dict[str, Any], bool]:
    if is_long:
        name, feedback = "joints polled, seldom", joints(rate_hz=0.5, timeout_s=2.0)
    else:
        name, feedback = dice.choice(FEEDBACKS)
    data = feedback.model_dump(mode="json", exclude_none=True)
    data["port"] = data["port"].replace("/dev/ttyUSB0", "/dev/ttyUSB9").replace(":502", ":5020")
    if data["port"].startswith("/"):
        data["line"] = "115200 8N1"  # a program that prints a hundred lines a second needs half of it
    if not is_long:
        data["timeout_s"] = _ROBOT_TIMEOUT_S
        if "rate_hz" in data:
            data["rate_hz"] = dice.choice((10, 50, 125))
    return name, data, carries_signal(feedback)


def what_to_record(gauges: int) -> dict[str, str]:
    """The test that so many gauges are enough for."""
    return {"test": "yaw", "direction": "acw"} if gauges > 1 else {"test": "radial"}
