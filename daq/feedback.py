"""Robot feedback by interface. A driver is a module of the app `daq/robot_drivers`, named after the `interface` in
the rig file, or a module of another package.

Its `host(feedback)` returns the listening conversation, with the values q1_deg … q6_deg, always all six, followed by
`rigs.schema.feedback.columns_beside_joints`. `device(feedback, read)` returns the controller side; `read(now_ns)`
returns the same values.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Any

from daq.protocol.conversation import Device, Host
from rigs.distribution import to_install
from rigs.errors import CellError
from rigs.schema.condition import UNDISTURBED
from rigs.schema.feedback import SIGNAL, Feedback, columns_beside_joints
from rigs.schema.plugins import driver_of

_DRIVERS = "daq.robot_drivers"
"""Package of the drivers that rig contains. They are imported by name, so a broken driver stops no other robot."""
Read = Callable[[int], Sequence[float]]


def load(feedback: Feedback) -> Any:
    try:
        return import_module(driver_of(feedback, _DRIVERS))
    except ModuleNotFoundError as missing:
        package = (missing.name or "").partition(".")[0]
        problem = f"{feedback.interface} needs the Python package {package}, which is not installed"
        raise CellError("feedback", problem, to_install(package), code="package.missing") from None


def host(feedback: Feedback) -> Host:
    conversation: Host = load(feedback).host(feedback)
    return conversation


def device(feedback: Feedback, read: Read) -> Device:
    """Emulated controller. Values that `read` omits at the end are those of a robot in normal operation."""
    usual = [({SIGNAL: 0.0} | UNDISTURBED)[name] for name in columns_beside_joints(feedback)]

    def read_values(now_ns: int) -> Sequence[float]:
        values = read(now_ns)
        return [*values, *usual[len(values) - 6 :]]

    conversation: Device = load(feedback).device(feedback, read_values)
    return conversation
