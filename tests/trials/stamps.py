"""Aligned times beside the times at which an emulated instrument latched its readings.

Every reading of that instrument is its number. In simulated time, exact and quick; or with --wire on ptys and a local
port in real time, through rigd and its store.
"""

from __future__ import annotations

import sys
import time
from argparse import Namespace
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import yaml

from analysis.runs.clocks import gauge_instants, robot_instants
from daq.apps.emulate.emulated_cell import Adversity
from daq.apps.emulate.instruments import emulated
from daq.apps.emulate.timed import STEADY
from daq.store import read_run
from rigs.load import find, parse
from rigs.schema.gauges import Gauge
from rigs.schema.probe import Timing
from tests.support.daemon_on_cell import daemon_on
from tests.support.stamp_cells import CELLS, DRIFT_PPM, GAUGES, JITTER_MS, LATENCIES_MS, TIMED, Errors, errors_of
from tests.support.stamped import GAUGE_STEP_MM, JOINT_STEP_DEG, MOVES, Latched, Stamped
from tests.support.trial import Trial, main

_ENOUGH = 0.9
"""Share of the times that must lie within twice their stated uncertainty; on the wire a loaded computer keeps the
emulated instruments themselves from their time, and there it is shown and not judged."""


Result = tuple[bool, str, Errors]
"""Whether on the wire, the name of the cell, and its errors."""


def draw(given: Namespace) -> Iterator[tuple[Namespace, str]]:
    """One case: instruments on the wire share a daemon."""
    yield from ((given, name) for name in ([""] if given.wire else CELLS))


def measured(case: tuple[Namespace, str]) -> list[Result]:
    given, name = case
    if given.wire:
        return [(True, *one) for one in _wired(given.seconds or 10.0)]
    return [(False, name, CELLS[name](seconds=given.seconds or 60.0, seed=given.seed))]


def report(done: Sequence[list[Result]]) -> str:
    rows = [row for rows in done for row in rows]
    samples = sum(len(errors.aligned) for *_, errors in rows)
    told = "NOT each truer than its arrival and within 2u" if is_bad(done) else "each truer than its arrival"
    return f"{len(rows)} cells, {samples} samples: {told}"


def is_bad(done: Sequence[list[Result]]) -> bool:
    return not all(
        _truer(row, 50) and (wire or (row.within_2u >= _ENOUGH and _truer(row, 99)))
        for rows in done
        for wire, _, row in rows
    )


def _wired(seconds: float) -> Iterator[tuple[str, Errors]]:
    plain = [
        (
            f"{name}, FTDI {latency_ms:g} ms" if latency_ms else f"{name}, no FTDI",
            gauge,
            gauge.timing,
            latency_ms,
            STEADY,
        )
        for name, gauge in GAUGES.items()
        for latency_ms in LATENCIES_MS
    ]
    timed = [
        (
            name,
            GAUGES[of.gauge].model_copy(update={"timing": of.timing}),
            of.stated or of.timing,
            of.latency_ms,
            of.unsteady,
        )
        for name, of in TIMED.items()
    ]
    for label, gauge, stated, latency_ms, unsteady in plain + timed:
        adversity = Adversity(latency_ms, JITTER_MS, DRIFT_PPM, unsteady)
        of_gauge, of_robot = _recorded(gauge, stated, adversity, seconds)
        yield label, of_gauge
        yield f"  RTDE beside it, {JITTER_MS:g} ms, {DRIFT_PPM:g} ppm", of_robot


class _Counting:
    """Emulated readings that contain the number of the read access."""

    def __init__(self, moves: int) -> None:
        self.gauge, self.robot = Latched(GAUGE_STEP_MM, 1, moves), Latched(JOINT_STEP_DEG, 6)

    def gauge_mm(self, name: str, now_ns: int) -> float:
        return self.gauge(now_ns)[0]

    def joints_deg(self, now_ns: int) -> list[float]:
        return list(self.robot(now_ns))


def _recorded(gauge: Gauge, stated: Timing, adversity: Adversity, seconds: float) -> tuple[Errors, Errors]:
    """The errors of gauge and robot in a run that rigd recorded, of a gauge whose timing is stated so."""
    data = yaml.safe_load(find("ur10e").read_text())
    data["gauges"] = {"g1": gauge.model_dump(mode="json", exclude_defaults=True)}
    text = yaml.safe_dump(data)
    rig, motion = parse(text, "stamps"), _Counting(MOVES if gauge.timing.latch == "own_cycle" else 1)
    cell = emulated(rig, motion, adversity=adversity)
    with daemon_on(cell, text) as client:
        client.ask("record_start", name="stamps", test="repeatability")
        time.sleep(seconds)
        run = read_run(Path(client.ask("record_stop")["run"]))
    g1, robot = run.streams["g1"], run.streams["robot"]
    stamped = Stamped(g1, motion.gauge.truth_ns(g1["g1_mm"]))
    moved = Stamped(robot, motion.robot.truth_ns(robot["q1_deg"]))
    return errors_of(stamped, gauge_instants(g1, gauge.model_copy(update={"timing": stated}))), errors_of(
        moved, robot_instants(robot)
    )


def line(rows: list[Result]) -> str:
    """Error of the aligned time in ms (p50, p99, maximum), compared with arrival times alone."""
    return "\n".join(
        f"{name:44} {len(found.aligned):8d} aligned {_numbers(found.aligned):>26} {100 * found.within_2u:5.0f}% in 2u, "
        f"by arrival {_numbers(found.arrival):>28}"
        for _, name, found in rows
    )


def _numbers(errors: np.ndarray) -> str:
    return " ".join(f"{value:8.3f}" for value in np.percentile(np.abs(errors), (50, 99, 100)))


def _truer(row: Errors, percent: float) -> bool:
    return bool(np.percentile(np.abs(row.aligned), percent) < np.percentile(np.abs(row.arrival), percent))


TRIAL = Trial(
    draw,
    measured,
    report,
    line=line,
    failed=is_bad,
    options={
        "seconds": (0.0, "of each cell (60 simulated, 10 on the wire)"),
        "wire": (False, "in real time, on ptys, through rigd"),
        "seed": (1, "of the simulated lines (1)"),
    },
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
