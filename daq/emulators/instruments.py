"""Instruments that measure a motion: the device side of each protocol, connected to a `MotionSource`.

Instruments on a shared line receive all requests and respond to those addressed to them.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Protocol

from daq import feedback, gauges
from daq.acquisition.streams import ROBOT, gauge_groups
from daq.emulators.emulated_cell import NONE, Adversity, EmulatedInstruments
from daq.emulators.timed import STEADY, OwnClock, Unsteady, timed_device, timed_read
from daq.protocol.conversation import ConversationStep, Device
from rigs.rig import Rig
from rigs.schema.condition import UNDISTURBED
from rigs.schema.feedback import SIGNAL, columns_beside_joints
from rigs.schema.modbus import ModbusMap, SolartronOrbit


class OneLine:
    def __init__(self, devices: Sequence[Device]) -> None:
        self._devices = devices
        self._wakes: list[int | None] = [None] * len(devices)

    @property
    def sent(self) -> int:
        return sum(device.sent for device in self._devices)

    def connected(self, now_ns: int) -> ConversationStep:
        return self._joined([device.connected(now_ns) for device in self._devices])

    def received(self, data: bytes, now_ns: int) -> ConversationStep:
        return self._joined([device.received(data, now_ns) for device in self._devices])

    def tick(self, now_ns: int) -> ConversationStep:
        due = [wake_ns is not None and wake_ns <= now_ns for wake_ns in self._wakes]
        asleep = [ConversationStep(wake_ns=wake_ns) for wake_ns in self._wakes]
        return self._joined([device.tick(now_ns) if due[n] else asleep[n] for n, device in enumerate(self._devices)])

    def _joined(self, steps: Sequence[ConversationStep]) -> ConversationStep:
        self._wakes = [step.wake_ns for step in steps]
        wake_ns = min((wake_ns for wake_ns in self._wakes if wake_ns is not None), default=None)
        return ConversationStep(b"".join(step.send for step in steps), (), wake_ns, any(step.hang_up for step in steps))


class MotionSource(Protocol):
    def gauge_mm(self, name: str, now_ns: int) -> float:
        """Reading of a gauge by name; nan if the head is disconnected."""

    def joints_deg(self, now_ns: int) -> Sequence[float]:
        """Six joint angles reported by the controller."""


def emulated(
    rig: Rig,
    motion: MotionSource,
    signal: Callable[[int], float] = lambda _: 0.0,
    adversity: Adversity = NONE,
    names: Path | None = None,
    condition: Callable[[int], Mapping[str, float]] = lambda _: {},
) -> EmulatedInstruments:
    """A cell of instruments measuring a motion.

    signal: program number of the robot at a time, if the feedback transmits it. condition: values that deviate from the
    normal condition of the robot at a time.
    """
    return EmulatedInstruments(rig, instruments_of(rig, motion, signal, adversity, condition), adversity, names)


def instruments_of(
    rig: Rig,
    motion: MotionSource,
    signal: Callable[[int], float] = lambda _: 0.0,
    adversity: Adversity = NONE,
    condition: Callable[[int], Mapping[str, float]] = lambda _: {},
) -> dict[str, Callable[[], Device]]:
    """A factory for each instrument by stream name, called for each connection."""
    further_columns = columns_beside_joints(rig.feedback)

    def read_values(now_ns: int) -> Sequence[float]:
        values = {SIGNAL: signal(now_ns)} | UNDISTURBED | dict(condition(now_ns))
        return [*motion.joints_deg(now_ns), *(values[name] for name in further_columns)]

    def controller() -> Device:
        return OwnClock(partial(feedback.device, rig.feedback), read_values, adversity.drift_ppm)

    devices = {"_".join(group): gauge_device(rig, motion, group, adversity.unsteady) for group in gauge_groups(rig)}
    return devices | {ROBOT: controller}


def gauge_device(
    rig: Rig, motion: MotionSource, group: Sequence[str], unsteady: Unsteady = STEADY
) -> Callable[[], Device]:
    """A factory for a device with these gauges, called for each connection.

    Latching follows `timing` in the rig file. The phase of the internal cycle depends only on the name.
    """
    members = {name: gauge for name, gauge in rig.gauges.recorded.items() if name in group}

    def instrument(names: Sequence[str]) -> Device:
        chance, timing = random.Random("_".join(names)), members[names[0]].timing

        def read(now_ns: int) -> Sequence[float]:
            return [motion.gauge_mm(name, now_ns) for name in names]

        device = gauges.device([members[name] for name in names], timed_read(read, timing, unsteady, chance))
        return timed_device(device, timing, unsteady, chance)

    def make_device() -> Device:
        by_unit: dict[int, list[str]] = {}
        for name, gauge in members.items():
            by_unit.setdefault(gauge.unit if isinstance(gauge, ModbusMap | SolartronOrbit) else 0, []).append(name)
        instruments = [instrument(names) for names in by_unit.values()]
        return instruments[0] if len(instruments) == 1 else OneLine(instruments)

    return make_device
