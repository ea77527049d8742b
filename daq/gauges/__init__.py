"""Gauge protocols, one per file. The file name is the `interface` in the rig file.

Each module contains two functions. `host(gauges)` returns the conversation that reads the gauges on a shared link, with
one value in mm per gauge, in order. `device(gauges, read)` returns the instrument side. `read(now_ns)` returns the
measured values in mm; nan means a head in error.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib import import_module

from daq.protocol.conversation import Device, Host
from rigs.schema.gauges import Gauge
from rigs.schema.plugins import driver_of

Read = Callable[[int], Sequence[float]]


def host(gauges: Sequence[Gauge]) -> Host:
    """Return the host side of the link shared by these gauges."""
    conversation: Host = import_module(driver_of(gauges[0], __name__)).host(gauges)
    return conversation


def device(gauges: Sequence[Gauge], read: Read) -> Device:
    """Return the instrument side of the link shared by these gauges."""
    conversation: Device = import_module(driver_of(gauges[0], __name__)).device(gauges, read)
    return conversation
