"""Aligned times beside the times at which an emulated instrument latched its readings.

Every reading of that instrument is its number. In simulated time, exact and quick; or with --wire on ptys and a local
port in real time, through rigd and its store.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
import yaml

from analysis.runs.clocks import gauge_instants, robot_instants
from daq.apps.emulate.emulated_cell import Adversity
from daq.apps.emulate.instruments import emulated
from daq.apps.emulate.timed import STEADY
from daq.store import read_run
from rigs.load import find, parse
from rigs.schema.gauges import Gauge
from rigs.schema.probe import Timing
from tests.support.stamp_cells import CELLS, DRIFT_PPM, GAUGES, JITTER_MS, LATENCIES_MS, TIMED, Errors, errors_of
from tests.support.stamped import GAUGE_STEP_MM, JOINT_STEP_DEG, MOVES, Latched, Stamped
from tests.trials.daemon_on_cell import daemon_on

_ENOUGH = 0.9
"""Share of the times that must lie within twice their stated uncertainty; on the wire a loaded computer keeps the
emulated instruments themselves from their time, and there it is shown and not judged."""


def main(
    seconds: Annotated[float, typer.Option(help="Of each cell. [default: 60 simulated, 10 on the wire]")] = 0.0,
    wire: Annotated[bool, typer.Option("--wire", help="In real time, on ptys, through rigd.")] = False,
    seed: Annotated[int, typer.Option(help="Of the simulated lines.")] = 1,
) -> None:
    """Print the error of the aligned time in ms (p50, p99, maximum), compared with arrival times alone."""
    print(f"{'':44} {'samples':>8} {'aligned p50, p99, worst':>26} {'2u':>6} {'by arrival p50, p99, worst':>28}")
    rows = list(_wired(seconds or 10.0)) if wire else list(_simulated(seconds or 60.0, seed))
    good = all(_truer(row, 50) and (wire or (row.within_2u >= _ENOUGH and _truer(row, 99))) for row in rows)
    samples = sum(len(row.aligned) for row in rows)
    told = "each truer than its arrival" if good else "NOT each truer than its arrival and within 2u"
    print(f"{len(rows)} cells, {samples} samples: {told}")
    raise typer.Exit(0 if good else 1)


def _simulated(seconds: float, seed: int) -> Iterator[Errors]:
    for name, measure in CELLS.items():
        yield _told(name, measure(seconds=seconds, seed=seed))


def _wired(seconds: float) -> Iterator[Errors]:
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
        yield _told(label, of_gauge)
        yield _told(f"  RTDE beside it, {JITTER_MS:g} ms, {DRIFT_PPM:g} ppm", of_robot)


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


def _told(name: str, found: Errors) -> Errors:
    aligned, arrival = (_numbers(errors) for errors in (found.aligned, found.arrival))
    print(
        f"{name:44} {len(found.aligned):8d} {aligned:>26} {100 * found.within_2u:5.0f}% {arrival:>28}",
        flush=True,
    )
    return found


def _numbers(errors: np.ndarray) -> str:
    return " ".join(f"{value:8.3f}" for value in np.percentile(np.abs(errors), (50, 99, 100)))


def _truer(row: Errors, percent: float) -> bool:
    return bool(np.percentile(np.abs(row.aligned), percent) < np.percentile(np.abs(row.arrival), percent))


if __name__ == "__main__":
    typer.run(main)
