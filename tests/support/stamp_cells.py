"""Cells whose timestamps are compared with the true times: each kind of line, adapter and clock, in simulated time.

The instruments are imperfect: the baud rate is 0.3 % low, answers start within 3 ms, the latching time before that is
random, and the clock runs 20 ppm fast. The host wakes up 0.1 ms late on average and never early. The frequency of an
internal cycle differs by up to 500 ppm and varies, each tick is up to 5 % of a cycle early or late, and one in 200 is
missing.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from analysis.runs.clocks import Instants, gauge_instants, robot_instants
from daq.emulators.timed import Unsteady
from rigs.schema.feedback import URRTDE
from rigs.schema.gauges import Gauge, KeyenceDLRS1A, ModbusMap, SylvacOptoRS
from rigs.schema.probe import Timing
from tests.support.stamped import Array, Stamped, gauge_run, network, robot_run, serial

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
HARSH = Unsteady(ppm=500.0, jitter=0.05, missed=0.005)
UNEVEN = Unsteady(pace=1 / 3)
"""60 ± 20 ms."""
SYLVAC, CONTINUOUS, KEYENCE, _ = GAUGES
RTDE = URRTDE(interface="ur_rtde", port="tcp://127.0.0.1:30004")


@dataclass(frozen=True)
class Errors:
    """Errors of timestamps (n,) in ms: after alignment, and by arrival time only. u (n,) ms: stated uncertainty
    after alignment.
    """

    aligned: Array
    arrival: Array
    u: Array

    @property
    def within_2u(self) -> float:
        """Share of aligned timestamps within two standard uncertainties."""
        return float(np.mean(np.abs(self.aligned) <= 2 * self.u))


def errors_of(stamped: Stamped, found: Instants) -> Errors:
    """Errors. Without alignment, a reading has the arrival time of its last byte."""
    arrival = stamped.columns["last_byte_ns"] - stamped.truth_ns
    u = 1e3 * np.hypot(found.u_s, found.own_u_s)
    return Errors((found.ns - stamped.truth_ns) / 1e6, arrival / 1e6, np.broadcast_to(u, len(arrival)))


@dataclass(frozen=True)
class Timed:
    """A gauge whose emulated timing may differ from its rig file.

    timing: real timing; stated: timing in the rig file, equal if None. unsteady: variation of the cycle. answer_ms,
    latched_ms: longest delay of answer and latching, typical if None.
    """

    gauge: str
    latency_ms: float
    timing: Timing
    stated: Timing | None = None
    unsteady: Unsteady = HARSH
    answer_ms: float = 3.0
    latched_ms: float | None = None

    def errors(self, seconds: float, seed: int = 1) -> Errors:
        """Read for a time and return the errors."""
        gauge = GAUGES[self.gauge].model_copy(update={"timing": self.timing})
        rng = np.random.default_rng(seed)
        wire = serial(rng, gauge.line.character_ns, self.latency_ms, self.answer_ms, latched_ms=self.latched_ms)
        stamped = gauge_run(gauge, wire, seconds, ppm=20.0, unsteady=self.unsteady, seed=seed)
        stated = gauge.model_copy(update={"timing": self.stated or self.timing})
        return errors_of(stamped, gauge_instants(stamped.columns, stated))


def gauge_errors(name: str, latency_ms: float, seconds: float) -> Errors:
    """Read a gauge behind an adapter for a time and return the errors."""
    gauge = GAUGES[name]
    wire = serial(np.random.default_rng(1), gauge.line.character_ns, latency_ms)
    stamped = gauge_run(gauge, wire, seconds, ppm=20.0)
    return errors_of(stamped, gauge_instants(stamped.columns, gauge))


def robot_errors(seconds: float) -> Errors:
    """Read RTDE from a controller with a drifting clock over a network with jitter, and return the errors."""
    stamped = robot_run(RTDE, network(np.random.default_rng(1), JITTER_MS), seconds, DRIFT_PPM)
    return errors_of(stamped, robot_instants(stamped.columns))


def own_cycle(cycle_ms: float, filter_ms: float = 0.0) -> Timing:
    """Timing of the latest reading of an internal cycle, or of the mean of the last few."""
    return Timing(latch="own_cycle", cycle_ms=cycle_ms, filter_ms=filter_ms)


_PACED = Timing(latch="streamed", cycle_ms=60.0)
TIMED = {
    f"{gauge.split(',')[0]}, own cycle {cycle_ms} ms, {adapter}": Timed(gauge, latency_ms, own_cycle(cycle_ms))
    for gauge, latency_ms, adapter in ((SYLVAC, 16.0, "FTDI 16 ms"), (KEYENCE, 0.0, "no FTDI"))
    for cycle_ms in (1, 20, 100, 200)
} | {
    "Sylvac polled, 100 ms, not stated": Timed(SYLVAC, 0.0, own_cycle(100), stated=Timing()),
    "Keyence, 20 ms, not stated, FTDI 16 ms": Timed(KEYENCE, 16.0, own_cycle(20), stated=Timing()),
    "Keyence, 20 ms, mean of 9, stated 5 % off": Timed(KEYENCE, 0.0, own_cycle(20, 80), stated=own_cycle(20, 84)),
    "Sylvac polled, 100 ms, mean of 5, FTDI 16 ms": Timed(SYLVAC, 16.0, own_cycle(100, 200)),
    "Sylvac polled, uneven cycle 60 ± 20 ms": Timed(SYLVAC, 0.0, own_cycle(60), unsteady=UNEVEN),
    "Keyence, uneven 60 ± 20 ms, not stated": Timed(KEYENCE, 0.0, own_cycle(60), stated=Timing(), unsteady=UNEVEN),
    "Sylvac continuous, 60 ± 20 ms, FTDI 16 ms": Timed(CONTINUOUS, 16.0, _PACED, unsteady=UNEVEN),
    "Sylvac continuous, 60 ± 20 ms, no FTDI": Timed(CONTINUOUS, 0.0, _PACED, unsteady=UNEVEN),
    "Sylvac continuous, 100 ms, FTDI 16 ms": Timed(CONTINUOUS, 16.0, own_cycle(100)),
    "Sylvac continuous, 30 ms, not stated": Timed(CONTINUOUS, 0.0, own_cycle(30), stated=Timing()),
    "Sylvac continuous, 20 ms, as long as a message": Timed(CONTINUOUS, 0.0, own_cycle(20)),
    "Sylvac polled, answers 30 ms later": Timed(SYLVAC, 0.0, Timing(latch="on_request", answer_delay_ms=30.0)),
    "Sylvac polled, latched in 1 ms, sent in 50": Timed(
        SYLVAC, 0.0, Timing(latch="on_request", latched_within_ms=1.0), answer_ms=50.0, latched_ms=1.0
    ),
}

CELLS = {
    f"{name}, FTDI {latency_ms:g} ms" if latency_ms else f"{name}, no FTDI": partial(gauge_errors, name, latency_ms)
    for name in GAUGES
    for latency_ms in LATENCIES_MS
} | {f"RTDE 500 Hz, jitter {JITTER_MS:g} ms, {DRIFT_PPM:g} ppm": robot_errors}
CELLS |= {name: timed.errors for name, timed in TIMED.items()}
