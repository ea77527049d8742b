"""Gauge protocols by interface. A driver is a module of the app `daq/gauge_drivers`, named after the `interface`
in the rig file, or a module of another package.

Its `host(gauges)` returns the conversation that reads the gauges on a shared link, with one value in mm per gauge.
`device(gauges, read)` returns the instrument side; `read(now_ns)` returns the measured values in mm, nan for a head in
error.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib import import_module

from daq.protocol.conversation import Device, Host
from rigs.schema.gauges import Gauge
from rigs.schema.plugins import driver_of

_DRIVERS = "daq.gauge_drivers"
"""Package of the drivers that rig contains. They are imported by name, so a broken driver stops no other gauge."""
Read = Callable[[int], Sequence[float]]


def host(gauges: Sequence[Gauge]) -> Host:
    """Conversation that reads gauges on a shared link: mm in the order given; nan for a gauge in error."""
    conversation: Host = import_module(driver_of(gauges[0], _DRIVERS)).host(gauges)
    return conversation


def device(gauges: Sequence[Gauge], read: Read) -> Device:
    conversation: Device = import_module(driver_of(gauges[0], _DRIVERS)).device(gauges, read)
    return conversation
