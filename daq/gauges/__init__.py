"""The gauges: one protocol a file, named as `interface` names it in the rig file.

Each file offers `host(gauges)`, the conversation that asks the gauges sharing one link for their readings
(values in mm, one a gauge, in order), and `device(gauges, read)`, the instrument's side of it, where
`read(now_ns)` gives what each gauge measures at that time in mm; nan means that its head shows an error.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib import import_module

from daq.protocol.conversation import Device, Host
from rigs.schema.gauges import Gauge
from rigs.schema.plugins import driver_of

Read = Callable[[int], Sequence[float]]


def host(gauges: Sequence[Gauge]) -> Host:
    """Return our side of the conversation on the link that these gauges share."""
    conversation: Host = import_module(driver_of(gauges[0], __name__)).host(gauges)
    return conversation


def device(gauges: Sequence[Gauge], read: Read) -> Device:
    """Return the instrument's side of the conversation on the link that these gauges share."""
    conversation: Device = import_module(driver_of(gauges[0], __name__)).device(gauges, read)
    return conversation
