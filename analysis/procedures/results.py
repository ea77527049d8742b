"""Evaluate runs for reports, plots and scripts; and check a new run while it can still be repeated."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any
from weakref import WeakValueDictionary

import numpy as np
import pyarrow as pa

from analysis.procedures.checks.check_runs import doubts_of, why_no_measurement
from analysis.procedures.circle import CircleResult
from analysis.procedures.shared.joint_reversals import JointReversal, reversals_of_rig
from analysis.procedures.shared.quantity import PLACE, Quantity
from analysis.procedures.shared.result_curves import ResultCurve
from analysis.procedures.shared.test_kind import Evaluated, Instruments, kind_of, labels_of
from analysis.runs.align import robot_only
from analysis.runs.loading import Measured, load_measured, measured_of
from analysis.runs.noise.certificate import NO_CERTIFICATE, Systematic
from analysis.runs.noise.spectrum import LapNoise
from analysis.runs.tables import CircleTable, format_of
from analysis.runs.tabular import Tabular, for_json, table_of_rows
from daq.store import read_run
from rigs.errors import DirectionError, FileError
from rigs.rig import Rig
from rigs.schema.vocabulary import CIRCLES, WITHOUT_GAUGES, Direction, TestName

BothNoises = tuple[LapNoise, LapNoise]
"""Noise of angle and distance of a circle."""


@dataclass(frozen=True)
class Result(Tabular):
    """Evaluated run.

    measured: the run.
    found: result of the test, in radians and mm.
    figures: figures by the names of docs/figures.md, which end in the unit.

    Example:

        result = evaluate(simulate("ur10e-cell", "radial"))
        print(result.title, result.figures["band_mm"])
        table = result.curve.to_table()
    """

    measured: Measured
    found: Evaluated
    figures: dict[str, Quantity]

    @cached_property
    def curve(self) -> ResultCurve:
        """Curve or points underlying the figures, in degrees and mm."""
        return self.found.as_curve

    @cached_property
    def reversals(self) -> tuple[JointReversal, ...]:
        """Joint reversals on the nominal circle, by circle angle; empty for other tests.

        Raises FileError if the robot of the rig file cannot drive its circle.
        """
        return reversals_of_rig(self.measured.rig) if isinstance(self.found, CircleResult) else ()

    @property
    def title(self) -> str:
        """Test and direction, such as `yaw acw`."""
        return self.measured.title

    @property
    def name(self) -> str:
        """Name of the run directory."""
        return self.measured.run.manifest.name

    @property
    def test(self) -> str:
        """Kind of test, such as `yaw`."""
        return self.measured.run.manifest.test

    @cached_property
    def doubts(self) -> tuple[str, ...]:
        """Warnings about run and figures, as text."""
        return (*doubts_of(self.measured), *self.found.notes)

    @property
    def without_rows(self) -> Result:
        """The same result without the rows of a circle, which saves memory for many runs, but with the digest of the
        readings.
        """
        measured, table = self.measured, self.measured.table
        if not isinstance(self.found, CircleResult) or not isinstance(table, CircleTable):
            return self
        run = replace(measured.run, table=None)
        vars(run)["readings_sha256"] = measured.run.readings_sha256
        none = replace(table, t_s=table.t_s[:0].copy(), q=table.q[:0].copy(), g_mm=table.g_mm[:0].copy(), u_t_s=None)
        bare = replace(measured, run=run, table=none)
        result = replace(self, measured=bare, found=self.found.without_rows)
        vars(result)["doubts"] = self.doubts
        return result

    @property
    def lap_noise(self) -> BothNoises | None:
        """Noise of angle and distance from the differences between laps; None for fewer than two."""
        if not isinstance(self.found, CircleResult) or self.found.laps.count < 2:
            return None
        return self.found.curve.noise, self.found.distance.curve.noise

    def to_table(self) -> pa.Table:
        """A row per figure: figure, value, u (standard uncertainty), unit, samples, noise."""
        rows = [{"figure": name, **asdict(figure)} for name, figure in self.figures.items()]
        return table_of_rows(("figure", "value", "u", "unit", "samples", "noise"), rows)

    def to_dict(self) -> dict[str, Any]:
        """Run, figures and doubts as plain types, with None for unknown values: the entry of a run in `rig
        analyse --json`.
        """
        manifest = self.measured.run.manifest
        warmth = self.measured.condition.warmth or {}
        plain: dict[str, Any] = for_json(
            {
                "run": str(self.measured.path),
                "name": manifest.name,
                "rig": self.measured.rig.name,
                "test": manifest.test,
                "direction": manifest.direction,
                "started": manifest.started,
                "samples": self.found.samples,
                "u_lag_s": self.measured.u_lag_s,
                "figures": {name: asdict(figure) for name, figure in self.figures.items()},
                "doubts": list(self.doubts),
                **({"axes": [asdict(axis) for axis in axes]} if (axes := getattr(self.found, "axes", ())) else {}),
                **({"warmth": {str(axis): asdict(warm) for axis, warm in warmth.items()}} if warmth else {}),
            }
        )
        return plain


def evaluate_runs(runs: Sequence[Measured]) -> list[Result]:
    """Evaluate runs. A run of a single lap uses the noise estimate of another run of its test. Raises FileError."""
    results = [result_of(run) for run in runs]
    for place, noise in borrowed_noise(results).items():
        results[place] = result_of(runs[place], noise)
    return results


def evaluate_path(path: Path, like: Mapping[Path, BothNoises] | None = None, *, with_rows: bool = True) -> Result:
    """Read and evaluate a run. Raises FileError.

    like: noise of another run by path, for runs of a single lap. with_rows: keep the rows, most of the memory of a
    result.
    """
    result = result_of(load_measured(path), like[path] if like else None)
    return result if with_rows else result.without_rows


def borrowed_noise(results: Sequence[Result]) -> dict[int, BothNoises]:
    """Noise for runs of a single lap, by index: that of the first longer run of the same test in the same cell."""
    places = {id(result): place for place, result in enumerate(results)}
    noises: dict[int, BothNoises] = {}
    for group in by_test(results):
        if noise := next((result.lap_noise for result in group if result.lap_noise), None):
            single = (run for run in group if isinstance(run.found, CircleResult) and run.found.laps.count == 1)
            noises |= {places[id(run)]: noise for run in single}
    return dict(sorted(noises.items()))


_KEPT: WeakValueDictionary[int, Result] = WeakValueDictionary()
"""Results by the identity of their run, as long as they are referenced: a report and its diagnosis share them."""


def result_of(measured: Measured, like: BothNoises | None = None) -> Result:
    """Evaluate a run. like: noise of angle and distance in a different run, for a single lap. Raises FileError."""
    kept = _KEPT.get(id(measured)) if like is None else None
    if kept is not None and kept.measured is measured:
        return kept
    instruments = Instruments(measured.u_lag_s, None, like)
    found = kind_of(measured.table.test).evaluate(measured.table, measured.rig, str(measured.path), instruments)
    figures = dict(found.figures)
    if isinstance(found, CircleResult):
        # Angle and distance both show the ball position; robot errors make them differ.
        distance = found.distance.figures
        figures |= {f"distance_{name}" if name in figures else name: figure for name, figure in distance.items()}
    figures = with_certificates(figures, measured.systematic, measured.rig, measured.run.manifest.test)
    friction = measured.condition.friction or {}
    figures |= {f"friction_j{axis}_a": Quantity(joint.current_a, joint.u_a, "a") for axis, joint in friction.items()}
    result = Result(measured, found, figures)
    if like is None:
        _KEPT[id(measured)] = result
    return result


def by_test(results: Sequence[Result]) -> list[list[Result]]:
    groups: list[list[Result]] = []
    for result in results:
        for group in groups:
            if _same_cell(group[0], result):
                group.append(result)
                break
        else:
            groups.append([result])
    return groups


def _same_cell(first: Result, second: Result) -> bool:
    rig, its = first.measured.rig, second.measured.rig
    # Cheap comparisons first: a year of a plant has over a thousand runs.
    if first.test != second.test or rig.name != its.name:
        return False
    if first.measured.run.manifest.placement != second.measured.run.manifest.placement:
        return False
    test = first.measured.table.test
    part = labels_of(test).part if format_of(test).gauges else ""  # without gauges, no place is stated
    same_place = not part or getattr(rig.tests, part) == getattr(its.tests, part)
    return same_place and rig.robot == its.robot


_END_S, _MOVES_RAD = 0.5, float(np.radians(0.05))
"""Time at the end of a run, and joint motion during it, that indicate an unfinished motion.

Both are five times those of a standstill.
"""


@dataclass(frozen=True)
class Fitness:
    """Usability of a finished run.

    why: reason why `rig analyse` would refuse it, or empty. drove: actual direction, if only the label is wrong.
    """

    why: str
    drove: Direction | None
    still_driving: bool


def fitness(run: Path) -> Fitness:
    why, drove, still_driving = "", None, False
    try:
        recorded = read_run(run)
        with suppress(FileError):
            t_s, q, _ = robot_only(run, recorded)
            still_driving = bool(np.ptp(q[t_s >= t_s[-1] - _END_S], axis=0).max() > _MOVES_RAD)
        if recorded.manifest.test not in WITHOUT_GAUGES:  # these have tables of their own
            measured = measured_of(recorded)
            why = why_no_measurement(measured)
            if not why:
                result_of(measured)
    except DirectionError as error:
        why, drove = error.what, error.drove
    except FileError as error:
        why = error.what
    return Fitness(why, drove, still_driving)


def why_unusable(run: Path) -> str:
    """Reason why `rig analyse` would refuse a run, or a convention makes it unusable; empty if valid."""
    return fitness(run).why


Figures = dict[str, Quantity]
_SHORTEST_MM = 0.3
"""Correlation length of a gauge error: errors of readings further apart are independent."""
_LENGTHS = ("radius_mm", "held_radius_mm", "ap_mm", "ap_mean_mm")
"""Figures shifted fully by an error common to all readings."""


def with_certificates(figures: Figures, systematic: Systematic, rig: Rig, test: TestName) -> Figures:
    """Figures with the uncertainty of certificates added in quadrature.

    The error of a gauge is an unknown smooth function of the reading. A wave as long as the gauge's travel affects a
    figure almost fully, longer ones less: the worst case is used. Comparisons between runs are not affected, because
    both have the same gauges.
    """
    if systematic == NO_CERTIFICATE or test in WITHOUT_GAUGES:
        return figures
    u = _u_of_circle if test in CIRCLES else _u_of_targets
    return {
        name: replace(figure, u=math.hypot(figure.u, u(name, figures, systematic, rig)))
        for name, figure in figures.items()
    }


def _u_of_circle(name: str, figures: Figures, systematic: Systematic, rig: Rig) -> float:
    if name.endswith(PLACE):
        return 0.0  # a position on the circle depends on the shape of the curve, not its size
    gauges_mm = math.hypot(*systematic.gauge_mm)
    angle_rad, distance_mm = gauges_mm / rig.gauges.baseline_mm, gauges_mm / 2
    if name == "shift_deg":
        amplitude_rad = math.radians(abs(figures["amplitude_deg"].value))
        return math.degrees(angle_rad / amplitude_rad) if amplitude_rad else 0.0
    if figures[name].unit == "deg":
        ends = 2 if name.startswith("range") else 1  # the two ends of a range can be wrong in opposite directions
        return ends * math.degrees(angle_rad)
    if "eccentricity" in name:
        radius_mm = rig.tests.circle.radius_mm if rig.tests.circle else 0.0
        return radius_mm * angle_rad if f"distance_{name}" in figures else distance_mm
    return math.hypot(distance_mm, math.sqrt(2) * systematic.ball_mm)


def _u_of_targets(name: str, figures: Figures, systematic: Systematic, rig: Rig) -> float:
    gauge_mm, ball_mm = systematic.gauge_mm[0], systematic.ball_mm
    if name in _LENGTHS:
        return math.hypot(gauge_mm, ball_mm, systematic.link_mm)
    apart = figures.get("held_band_mm", figures[name]) if name.startswith("centre_") else figures[name]
    difference_mm = math.sqrt(2) * gauge_mm * min(1.0, abs(apart.value) / _SHORTEST_MM)
    about_ball = name.startswith(("centre_", "band", "held_band"))  # from targets with different contact points
    return math.hypot(difference_mm, math.sqrt(2) * ball_mm if about_ball else 0.0)
