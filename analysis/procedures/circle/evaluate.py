"""Angle between link and tool over a circle: common part of yaw and roll, after Oh 2019, section 2.1.

The residual of the angle after removing the least-squares sine, eqs. (1) to (11), is the orientation error, and its
range the error band. Yaw and roll define their additional figures.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from importlib import import_module
from typing import cast

import numpy as np

from analysis.procedures.circle.circularity import Circularity
from analysis.procedures.circle.circularity import evaluate as evaluate_distance
from analysis.procedures.shared.evaluate import (
    Evaluation,
    Instruments,
    check_numbers,
    check_radius,
    require_live_gauges,
)
from analysis.procedures.shared.lap_curve import SEED, LapCurve, at_resolution, curve_of, figures
from analysis.procedures.shared.quantity import Quantity
from analysis.procedures.shared.reduction import PHI, Reduced, nodes_of, reduced
from analysis.procedures.shared.result_curves import CircleCurve
from analysis.procedures.shared.simulated_gauges import Simulation, read_by_gauges
from analysis.robot.geometry.circle import link_angle
from analysis.robot.geometry.driven_programs import circle_laps, circle_of
from analysis.robot.kinematics.arm import Array
from analysis.robot.model.predict import SetUp
from analysis.runs.laps import Laps, laps_of
from analysis.runs.noise.spectrum import DRAWS, NODES, LapNoise
from analysis.runs.tables import CircleTable
from rigs.errors import FileError
from rigs.readiness import require_test
from rigs.rig import Rig
from rigs.schema.vocabulary import CircleTest, Direction, TestName


def angle_of_gauges(g_mm: Array, baseline_mm: float) -> Array:
    """Return the angle (...,) rad of readings (..., 2) mm of gauges with a baseline."""
    return link_angle(g_mm[..., 0], g_mm[..., 1], baseline_mm)


Plain = Callable[[Array, float], Mapping[str, Array]]
"""Figures (...,) by name of angles (..., NODES) rad on a circle of a radius in mm."""


@dataclass(frozen=True)
class Measure:
    """Figures of a test from the angle over a circle.

    figures_at: function that computes them. ranges: names of figures biased upwards by noise, such as a range. They are
    lowered by the mean contribution of the noise.
    """

    figures_at: Plain
    ranges: frozenset[str] = frozenset()


@dataclass(frozen=True)
class Sine:
    """Least-squares A + a sin(phi) + b cos(phi), eq. (4), in rad."""

    A: float
    a: float
    b: float

    def __call__(self, phi: Array) -> Array:
        """Return the values (n,) at phi (n,)."""
        return np.asarray(self.A + self.a * np.sin(phi) + self.b * np.cos(phi))

    @property
    def amplitude(self) -> float:
        """r of eq. (11)."""
        return float(np.hypot(self.a, self.b))

    @property
    def shift(self) -> float:
        """alpha of eq. (11), by atan2, because arctan(b/a) loses the quadrant. (The paper's last formula for it has b11
        instead of b21.)"""
        return float(np.arctan2(self.b, self.a))


def sine_of(y: Array) -> tuple[Array, Array, Array]:
    """Return A, a and b (...,) of the least-squares sine of eq. (2) for curves (..., NODES).

    Nodes are equidistant, so the paper's sums are those of the level and the first order.
    """
    fitted = y @ _FIRST_ORDER
    return fitted[..., 0], fitted[..., 1], fitted[..., 2]


_FIRST_ORDER = np.stack([np.ones(NODES), 2 * np.sin(PHI), 2 * np.cos(PHI)], axis=1) / NODES
"""Weights (NODES, 3) for the least-squares level, sine and cosine of a curve."""


def fit_sine(phi: Array, y: Array) -> Sine:
    """Return the sine of a noise-free curve y (n,) rad at phi (n,) rad of one lap."""
    A, a, b = sine_of(nodes_of(phi, y))
    return Sine(float(A), float(a), float(b))


@dataclass(frozen=True)
class CircleResult:
    """Result of one direction.

    angle, residual: (NODES,) rad over PHI, the residual at the stated resolution. curve: angle with its noise.
    distance: from
    the mean of the gauges. u_lag_s, u_scale: assumed uncertainties of the gauges' time and of the baseline (relative).
    """

    laps: Laps
    angle: Array
    residual: Array
    sine: Sine
    figures: dict[str, Quantity]
    samples: int
    notes: tuple[str, ...]
    curve: LapCurve
    distance: Circularity
    u_lag_s: float
    u_scale: float

    @property
    def as_curve(self) -> CircleCurve:
        """Return angle, error and deviation over the circle angle."""
        error, _ = error_of(self.curve.errors)
        return CircleCurve(
            phi_deg=np.degrees(PHI),
            angle_deg=np.degrees(self.angle),
            error_deg=np.degrees(self.residual),
            error_u_deg=np.degrees(error.std(axis=0)),
            deviation_mm=self.distance.deviation_mm,
        )

    @property
    def without_rows(self) -> CircleResult:
        """Return the result with the rows of the first lap only, and without noise draws, recreated on demand."""
        distance = replace(self.distance, curve=self.distance.curve.without_draws)
        return replace(self, laps=self.laps.without_rows, curve=self.curve.without_draws, distance=distance)


@dataclass(frozen=True)
class AngleTest:
    """Yaw or roll. measures: computed from the angle. notes_of: remarks on a result."""

    measures: tuple[Measure, ...]
    notes_of: Callable[[CircleResult], tuple[str, ...]]

    def figures_at(self, y: Array, radius_mm: float) -> dict[str, Array]:
        """Return the figures (...,) of all measures, from angles y (..., NODES) rad."""
        return {name: value for measure in self.measures for name, value in measure.figures_at(y, radius_mm).items()}

    def evaluate(
        self,
        laps: Laps,
        baseline_mm: float,
        baseline_u_mm: float,
        u_lag_s: float,
        where: str = "the run",
        like: tuple[LapNoise, LapNoise] | None = None,
        run: Reduced | None = None,
    ) -> CircleResult:
        """Return the figures of a run's laps with uncertainties, ranges corrected for noise.

        like: noise of angle and distance in a different run of the cell, for a run of one lap. run: all readings, if
        the laps are thinned. Raises FileError for readings impossible with a ball link.
        """
        _hold(laps, baseline_mm, where)
        run = run or reduced(laps)

        curve = curve_of(
            run, partial(angle_of_gauges, baseline_mm=baseline_mm), np.sqrt(2) / abs(baseline_mm), 0, like and like[0]
        )
        radius, u_scale = laps.frame.radius, baseline_u_mm / abs(baseline_mm)
        rng = np.random.default_rng(SEED)
        turned = curve.turned(rng.normal(0.0, u_lag_s, DRAWS))
        scale = 1.0 + rng.normal(0.0, u_scale, DRAWS)

        def draw_noise(curves: Sequence[Array]) -> list[Array]:
            return [curve.draw_noise(curves[0], turned, scale)]

        ranges = frozenset[str]().union(*(measure.ranges for measure in self.measures))
        of_angle = figures(lambda y: self.figures_at(y[0], radius), [curve], draw_noise, run.samples, ranges)
        sine = Sine(*(float(part) for part in sine_of(curve.y)))
        residual = at_resolution(curve.y - sine(PHI))
        distance = evaluate_distance(run, laps, u_lag_s, where, like and like[1])
        notes = (*laps.notes, *run.notes, *_about_noise(curve))
        count = run.samples
        result = CircleResult(laps, curve.y, residual, sine, of_angle, count, notes, curve, distance, u_lag_s, u_scale)
        return replace(result, notes=(*notes, *self.notes_of(result)))

    def plain_figures(self, phi: Array, y: Array, radius_mm: float) -> dict[str, float]:
        """Return the figures of a noise-free curve y (n,) rad over phi (n,) rad, defined in docs/conventions.md."""
        return {name: float(value) for name, value in self.figures_at(nodes_of(phi, y), radius_mm).items()}


def _about_noise(curve: LapCurve) -> tuple[str, ...]:
    """Return remarks about noise not measured in this run, and about events between its laps."""
    if curve.slips:
        sizes = ", ".join(f"{np.degrees(slip):+z.4f}°" for slip in curve.slips)
        why = "which is more than noise and drift explain: check the clamps"
        return (f"the angle steps by {sizes} between laps, {why}",)
    match curve.noise.source:
        case "borrowed":
            return (
                "the run has one lap: the slow noise is taken from a different run of this cell, at an unknown level",
            )
        case "assumed":
            why = "the noise of real cells is assumed; drive two laps"
            return (f"a single lap cannot show slow noise: {why}",)
    return ()


def eccentricities(result: CircleResult) -> tuple[Array, Array]:
    """Return the ball position relative to the centre along u and v, (2,) mm each: from the angle of a yaw, and from
    the distance."""
    radius = result.laps.frame.radius
    by_angle = radius * np.array([-result.sine.a, result.sine.b])
    return by_angle, result.distance.ball_mm


def sine_figures(y: Array, _radius_mm: float) -> dict[str, Array]:
    """Return band, amplitude, shift and offset (...,) in degrees of angles y (..., NODES) rad: the paper's 2.1."""
    A, a, b = sine_of(y)
    error = at_resolution(y - _sines(A, a, b))
    return {
        "band_deg": np.degrees(np.ptp(error, axis=-1)),
        "amplitude_deg": np.degrees(np.hypot(a, b)),
        "shift_deg": np.degrees(np.arctan2(b, a)),
        "offset_deg": np.degrees(A),
    }


SINE = Measure(sine_figures, frozenset({"band_deg"}))


def error_of(y: Array) -> tuple[Array, Array]:
    """Return orientation errors (..., NODES) rad of angles y (..., NODES) rad, and these plus their sine, at the
    stated resolution."""
    sine = _sines(*sine_of(y))
    error = at_resolution(y - sine)
    return error, error + sine


def _sines(A: Array, a: Array, b: Array) -> Array:
    return np.asarray(A[..., None] + a[..., None] * np.sin(PHI) + b[..., None] * np.cos(PHI))


def _hold(laps: Laps, baseline_mm: float, where: str) -> None:
    if laps.g_mm.ndim != 2 or laps.g_mm.shape[1] != 2:
        raise FileError(where, "does not have two gauges, and an angle needs two", "give g1_mm and g2_mm")
    if baseline_mm == 0:
        problem = "the gauges have the same offset_mm, which cannot measure an angle"
        raise FileError(where, problem, "correct offset_mm of g1 and g2 in the rig file")
    check_radius(where, laps.frame.radius)
    check_numbers(where, t_s=laps.t_s, q=laps.q, g1_mm=laps.g_mm[:, 0], g2_mm=laps.g_mm[:, 1])
    require_live_gauges(where, g1_mm=laps.g_mm[:, 0], g2_mm=laps.g_mm[:, 1])


GAUGE_RATE_HZ = 50.0
"""Readings per second of a simulated circle: those of a 4800 baud line."""


def planted_setup(rig: Rig) -> SetUp:
    """Return the set-up of simulations and emulated cells on a circle: the ball at the position of the rig file."""
    ball = np.array(circle_of(rig).centre_mm) + np.array(circle_of(rig).eccentricity_mm)
    return SetUp(ball, np.zeros(2), np.eye(4), np.eye(4))


class CircleEvaluation(Evaluation[CircleTable]):
    """Evaluation of a yaw or roll test, with the value `ANGLE` of the module `yaw` or `roll`."""

    def __init__(self, test: TestName) -> None:
        super().__init__(test)
        self._test = cast("CircleTest", test)
        self._angle: AngleTest = import_module(f"{__package__}.{test}").ANGLE

    def evaluate(self, table: CircleTable, rig: Rig, where: str, instruments: Instruments) -> CircleResult:
        gauges = rig.gauges
        if gauges.g2 is None:
            raise FileError(where, "has a single gauge, but an angle needs two", "add gauges.g2 to the rig file")
        laps = laps_of(table, rig, where)
        lag_and_noise = (instruments.u_lag_s, where, instruments.like, instruments.reduced)
        return self._angle.evaluate(laps, gauges.baseline_mm, gauges.baseline_u_mm, *lag_and_noise)

    def require_evaluable(self, table: CircleTable, rig: Rig, where: str) -> None:
        """Check that the run contains laps."""
        laps_of(table, rig, where)

    def simulated(self, rig: Rig, direction: Direction | None, run: Simulation) -> CircleTable:
        require_test(rig, self.test)
        if direction is None:
            raise FileError(f"{self.test} test", "needs a direction", "give --direction cw, acw or both")
        laps = circle_laps(rig, direction)
        t_s = np.arange(0.0, laps.end_s, 1.0 / GAUGE_RATE_HZ)
        table = CircleTable(self._test, direction, t_s, laps.at(t_s), np.empty((0, 2)))
        return replace(table, g_mm=read_by_gauges(rig, table, planted_setup(rig), run))


PART = CircleEvaluation
