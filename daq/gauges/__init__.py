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
    """Return the host side of the protocol for gauges that share a link. Raises CellError if a required package is
    missing.

    Samples contain a value in mm for each gauge, in the order given; nan for a gauge in error.
    """
    conversation: Host = import_module(driver_of(gauges[0], __name__)).host(gauges)
    return conversation


def device(gauges: Sequence[Gauge], read: Read) -> Device:
    """Return the emulated instrument for gauges that share a link, the device side of the protocol.

    `read(now_ns)` gives the measured values in mm, in the order of the gauges; nan for a head in error.
    """
    conversation: Device = import_module(driver_of(gauges[0], __name__)).device(gauges, read)
    return conversation
