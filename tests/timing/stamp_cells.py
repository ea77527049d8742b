"""The cells whose stamps are held against the truth: each kind of line, adapter and clock, in simulated time.

The instrument is no ideal one: its baud is 0.3 % slow, it begins to answer anywhere in 3 ms and latched anywhere
before, its clock runs 20 ppm fast; the host wakes 0.1 ms late on average, and never early.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from stamped import Array, Stamped, gauge_run, network, robot_run, serial

from analysis.reading.clocks import Instants, gauge_instants, robot_instants
from rigs.feedback import URRTDE
from rigs.gauges import Gauge, KeyenceDLRS1A, ModbusMap, SylvacOptoRS

LATENCIES_MS = (16.0, 1.0, 0.0)
JITTER_MS, DRIFT_PPM = 5.0, 30.0
_PLACE = {"port": "/dev/ttyUSB0", "offset_mm": 25}
_BAUMER = {
    "unit": 1,
    "function": 4,
    "address": 200,
    "count": 13,
    "word_order": "little",
    "value": {"address": 202, "type": "float32"},
    "clock_s": {"address": 209, "type": "uint32"},
    "clock_us": {"address": 211, "type": "uint32"},
}
GAUGES: dict[str, Gauge] = {
    "Sylvac polled, 4800 7E2": SylvacOptoRS(interface="sylvac_opto_rs", **_PLACE),
    "Sylvac continuous, 4800 7E2": SylvacOptoRS(interface="sylvac_opto_rs", mode="continuous", **_PLACE),
    "Keyence, 115200 8N1": KeyenceDLRS1A.model_validate(
        {"interface": "keyence_dl_rs1a", "line": "115200 8N1", "timing": {"latch": "on_request"}, **_PLACE}
    ),
    "Baumer with its clock, 57600 8E1": ModbusMap.model_validate(
        {"interface": "modbus_map", "line": "57600 8E1", **_PLACE, **_BAUMER}
    ),
}
RTDE = URRTDE(interface="ur_rtde", port="tcp://127.0.0.1:30004")


@dataclass(frozen=True)
class Errors:
    """How far stamps are from the truth, (n,) ms: aligned, and by the arrival alone; u (n,) ms: what is said of the
    aligned ones."""

    aligned: Array
    arrival: Array
    u: Array

    @property
    def within_2u(self) -> float:
        """Share of the aligned that lie within two of their standard uncertainties."""
        return float(np.mean(np.abs(self.aligned) <= 2 * self.u))


def errors_of(stamped: Stamped, found: Instants) -> Errors:
    """A reading is there when its last byte is: that is the time it has without any alignment."""
    arrival = stamped.columns["last_byte_ns"] - stamped.truth_ns
    u = 1e3 * np.hypot(found.u_s, found.own_u_s)
    return Errors((found.ns - stamped.truth_ns) / 1e6, arrival / 1e6, np.broadcast_to(u, len(arrival)))


def gauge_errors(name: str, latency_ms: float, seconds: float, seed: int = 1) -> Errors:
    """One of the gauges behind an adapter, read for so long."""
    gauge = GAUGES[name]
    wire = serial(np.random.default_rng(seed), gauge.line.character_ns, latency_ms)
    stamped = gauge_run(gauge, wire, seconds, ppm=20.0)
    return errors_of(stamped, gauge_instants(stamped.columns, gauge))


def robot_errors(seconds: float, seed: int = 1) -> Errors:
    """RTDE over a network with jitter, from a controller whose clock drifts."""
    stamped = robot_run(RTDE, network(np.random.default_rng(seed), JITTER_MS), seconds, DRIFT_PPM)
    return errors_of(stamped, robot_instants(stamped.columns))


CELLS = {
    f"{name}, FTDI {latency_ms:g} ms" if latency_ms else f"{name}, no FTDI": partial(gauge_errors, name, latency_ms)
    for name in GAUGES
    for latency_ms in LATENCIES_MS
} | {f"RTDE 500 Hz, jitter {JITTER_MS:g} ms, {DRIFT_PPM:g} ppm": robot_errors}
