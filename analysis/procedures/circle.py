"""Yaw and roll tests: the angle between link and tool over a circle (Oh 2019, sections 2.1 and 2.2), and its
circularity.

The residual of the angle after removing the least-squares sine, eqs. (1) to (11), is the orientation error, and its
range the error band.

Yaw, about the circle's normal: the base-ball is never exactly in the circle's centre, so yaw = atan2(-e_u sin + e_v
cos, R - …), with the exact first harmonic (-e_u sin + e_v cos)/R. The distance, the mean of the gauges, shows the same
eccentricity independently; `analysis.procedures.checks.gauges` detects exchanged gauges.

Roll, about the tangent: atan2(l·x_T, l·z_T). An eccentricity in the plane gives no first-order sine, and the height h
of the ball along n gives the constant atan(h/R), indistinguishable from a difference of the gauge zeros. A sine is
caused by the robot, or by a tilt of the plane actually driven; the orientation error is by definition
(docs/conventions.md) the remainder. The paper removes no sine in figures 10 and 11, whose extremes are 135° apart, so
the range of the total angle is reported in addition to the band.

Circularity, of the distance (ISO 230-4:2005, clause 3): the circular deviation G is the range of the radial deviations
about the least-squares circle. The absolute length of the link is unknown (it includes the gauge zeros), so the radial
deviation F and the mean radius D of the standard are not reported. The distance of P = C + R r(phi) from B = C + e is
|R r(phi) - e|, and this curve is fitted, not only its first harmonic: the second harmonic e²/4R is not an error of the
robot (2 µm for 0.7 mm at 70 mm). The factor 1/(l·z_T) of a reading is ignored: its effect is below 1 µm for angles
below 1° and gauges within 5 mm of zero.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar

import numpy as np

from analysis.procedures.checks.columns import PLACE_UNKNOWN, judged_by_path, off_circle
from analysis.procedures.checks.gauges import ORDER, order_findings
from analysis.procedures.checks.places import STAMPS, stamp_findings
from analysis.procedures.checks.units import circle_gauges, impossible
from analysis.procedures.shared.lap_curve import (
    PHI,
    SEED,
    LapCurve,
    Reduced,
    at_resolution,
    curve_of,
    figures,
    nodes_of,
    reduced,
)
from analysis.procedures.shared.quantity import Quantity
from analysis.procedures.shared.result_curves import CircleCurve
from analysis.procedures.shared.test_kind import (
    Facts,
    Finders,
    Finding,
    Instruments,
    Labels,
    PathDeviation,
    Simulation,
    TestKind,
    Verdict,
    check_numbers,
    check_radius,
    require_live_gauges,
)
from analysis.procedures.simulate import read_by_gauges
from analysis.robot.geometry.circle import frame_of, link_angle, link_readings
from analysis.robot.geometry.driven_programs import circle_laps, circle_of
from analysis.robot.kinematics.arm import Array, Integers
from analysis.robot.predict import Model, ModelScene, Motion, Path, SetUp, apply, gauged
from analysis.runs.align import Aligned
from analysis.runs.laps import Laps, laps_of
from analysis.runs.noise.spectrum import DRAWS, NODES, LapNoise
from analysis.runs.tables import CircleTable, Rows
from rigs.errors import FileError
from rigs.readiness import require_test
from rigs.rig import Rig
from rigs.schema.vocabulary import CircleTest, Direction

DISTANCE_RANGES = frozenset({"circular_deviation_mm"})
"""Figures of the distance that noise increases."""
_ROUNDS = 4
"""Rounds of Gauss-Newton; an eccentricity of a tenth of the radius needs three to reach 1 nm."""


@dataclass(frozen=True)
class Circularity:
    """Circular deviation of one direction.

    deviation_mm (NODES,): over PHI, positive outwards, at the stated resolution. curve: distance between tool and ball.
    ball_mm (2,): centre of the least-squares circle, along u and v.
    """

    deviation_mm: Array
    curve: LapCurve
    ball_mm: Array
    figures: dict[str, Quantity]


def evaluate_distance(run: Reduced, radius: float, u_lag_s: float, like: LapNoise | None = None) -> Circularity:
    """Circular deviation G, noise-corrected, and eccentricity of the ball from the distance, which orientation errors
    do not change.
    """
    curve = curve_of(run, mean_of_gauges, np.sqrt(0.5), 1, like)
    turned = curve.turned(np.random.default_rng(SEED).normal(0.0, u_lag_s, DRAWS))

    def draw_noise(curves: Sequence[Array]) -> list[Array]:
        return [curve.draw_noise(curves[0], turned, np.ones(DRAWS))]

    of_distance = figures(
        lambda d: distance_figures_at(d[0], radius), [curve], draw_noise, run.samples, DISTANCE_RANGES
    )
    fit = fit_circle(curve.y, radius)
    return Circularity(at_resolution(curve.y - circle_at(fit, radius)), curve, fit[:2], of_distance)


def distance_figures_at(distance: Array, radius_mm: float) -> dict[str, Array]:
    fit, circle = circle_through(distance, radius_mm)
    deviation = at_resolution(distance - circle)
    return {
        "circular_deviation_mm": np.ptp(deviation, axis=-1),
        "eccentricity_u_mm": fit[..., 0],
        "eccentricity_v_mm": fit[..., 1],
        "eccentricity_mm": np.hypot(fit[..., 0], fit[..., 1]),
    }


def mean_of_gauges(g_mm: Array) -> Array:
    """Distance in mm relative to the gauge zeros."""
    return np.asarray((g_mm[..., 0] + g_mm[..., 1]) / 2)


def fit_circle(distance: Array, radius_mm: float) -> Array:
    """Least-squares e_u, e_v and constant c, (..., 3) mm, of |R r(phi) - e| + c for distances (..., NODES) mm."""
    return circle_through(distance, radius_mm)[0]


def circle_through(distance: Array, radius_mm: float) -> tuple[Array, Array]:
    """Fit of `fit_circle`, and the distances of the fitted circle.

    The derivatives by e_u and e_v are close to -cos and -sin, so each round removes the orders 0 and 1 of the residual.
    """
    # Draws are within micrometres of their mean: one or two rounds starting at its fit are sufficient.
    fit = np.zeros(3)
    mean = distance.reshape(-1, NODES).mean(axis=0)
    for _ in range(_ROUNDS):
        fit = fit + _orders(mean - circle_at(fit, radius_mm))
    fit = fit + _orders(distance - circle_at(fit, radius_mm))
    circle = circle_at(fit, radius_mm)
    # The last step is nanometres, so the approximate derivatives are exact enough.
    last = _orders(distance - circle)
    return fit + last, circle + last @ _WAVES


_WAVES = np.stack([-np.cos(PHI), -np.sin(PHI), np.ones(NODES)])
"""Derivatives (3, NODES) of a distance by e_u, e_v and c, for a ball close to the centre."""


def _orders(y: Array) -> Array:
    """Least-squares components (..., 3) of curves (..., NODES) along _WAVES; nodes are equidistant."""
    return np.asarray(y @ (_WAVES * np.array([2.0, 2.0, 1.0])[:, None] / NODES).T)


def circle_at(fit: Array, radius_mm: float) -> Array:
    """|R r(phi) - e| + c (..., NODES) mm over PHI, for fits (..., 3) mm."""
    x, y = radius_mm * np.cos(PHI) - fit[..., 0, None], radius_mm * np.sin(PHI) - fit[..., 1, None]
    return np.asarray(np.hypot(x, y) + fit[..., 2, None])


_FIRST_ORDER = np.stack([np.ones(NODES), 2 * np.sin(PHI), 2 * np.cos(PHI)], axis=1) / NODES
"""Weights (NODES, 3) for the least-squares level, sine and cosine of a curve."""
GAUGE_RATE_HZ = 50.0
"""Readings per second of a simulated circle: those of a 4800 baud line."""
_APART_MM, _APART = 0.2, 0.5
"""Absolute and relative difference above which two eccentricities hardly belong to the same ball."""
_CLEAR_MM, _ALIKE = 0.2, 0.3
"""Eccentricity from which, and relative difference below which, the sine of a roll equals the eccentricity from the
distance. A sine caused by the robot has this size and direction only by chance.
"""


@dataclass(frozen=True)
class Sine:
    """Least-squares A + a sin(phi) + b cos(phi), eq. (4), in rad."""

    A: float
    a: float
    b: float

    def __call__(self, phi: Array) -> Array:
        return np.asarray(self.A + self.a * np.sin(phi) + self.b * np.cos(phi))


def sine_of(y: Array) -> tuple[Array, Array, Array]:
    """A, a and b (...,) of the least-squares sine of eq. (2) for curves (..., NODES), whose nodes are equidistant."""
    fitted = y @ _FIRST_ORDER
    return fitted[..., 0], fitted[..., 1], fitted[..., 2]


def fit_sine(y: Array) -> Sine:
    A, a, b = sine_of(y)
    return Sine(float(A), float(a), float(b))


def error_of(y: Array) -> tuple[Array, Array]:
    """Orientation errors (..., NODES) rad of angles, and these plus their sine, at the stated resolution."""
    A, a, b = sine_of(y)
    sine = np.asarray(A[..., None] + a[..., None] * np.sin(PHI) + b[..., None] * np.cos(PHI))
    error = at_resolution(y - sine)
    return error, error + sine


def sine_figures(y: Array, _radius_mm: float) -> dict[str, Array]:
    """Band, amplitude, shift and offset in degrees: the paper's 2.1.

    The shift is alpha of eq. (11), by atan2, because arctan(b/a) loses the quadrant. (The paper's last formula for it
    has b11 instead of b21.)
    """
    A, a, b = sine_of(y)
    return {
        "band_deg": np.degrees(np.ptp(error_of(y)[0], axis=-1)),
        "amplitude_deg": np.degrees(np.hypot(a, b)),
        "shift_deg": np.degrees(np.arctan2(b, a)),
        "offset_deg": np.degrees(A),
    }


def eccentricity_figures(y: Array, radius_mm: float) -> dict[str, Array]:
    """Eccentricity of the base-ball in mm along u and v = n × u, and its length."""
    _, a, b = sine_of(y)
    return {
        "eccentricity_u_mm": -radius_mm * a,
        "eccentricity_v_mm": radius_mm * b,
        "eccentricity_mm": radius_mm * np.hypot(a, b),
    }


def range_figures(y: Array, _radius_mm: float) -> dict[str, Array]:
    """Range of the total angle, and the circle angles of all extremes, in degrees."""
    error, whole = error_of(y)
    at = np.degrees(PHI)
    return {
        "max_at_deg": at[np.argmax(error, axis=-1)],
        "min_at_deg": at[np.argmin(error, axis=-1)],
        "range_deg": np.degrees(np.ptp(whole, axis=-1)),
        "range_max_at_deg": at[np.argmax(whole, axis=-1)],
        "range_min_at_deg": at[np.argmin(whole, axis=-1)],
    }


@dataclass(frozen=True)
class CircleResult:
    """Result of one direction: angle and residual (NODES,) rad over PHI, the residual at the stated resolution.

    distance: from the mean of the gauges. u_lag_s, u_scale: assumed uncertainties of the gauges' time and of the
    baseline (relative).
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
        error, _ = error_of(self.curve.errors)
        return CircleCurve(
            phi_deg=np.degrees(PHI),
            angle_deg=np.degrees(self.angle),
            error_deg=np.degrees(self.residual),
            error_u_deg=np.degrees(error.std(axis=0)),
            deviation_mm=self.distance.deviation_mm,
        )

    @property
    def eccentricities_mm(self) -> tuple[Array, Array]:
        """Ball position along u and v, (2,) each: from the angle of a yaw, from the distance."""
        return self.laps.frame.radius * np.array([-self.sine.a, self.sine.b]), self.distance.ball_mm

    @property
    def without_rows(self) -> CircleResult:
        """The result with the first row only, and without noise draws, which are recreated on demand."""
        distance = replace(self.distance, curve=replace(self.distance.curve))
        return replace(self, laps=self.laps.without_rows, curve=replace(self.curve), distance=distance)


class Circle(TestKind[CircleTable]):
    """Common part of yaw and roll."""

    test: ClassVar[CircleTest]
    facts = Facts(setup_terms=5)
    labels = Labels(example=("circular_deviation_mm", 0.05, 0.10), part="circle", along="phi_deg")
    table = CircleTable
    fields = ("t_s", "direction", "q", "g_mm")
    further = (("phi_deg",), ("u_t_s",), ("u_lag_s",))
    gauges = ("g1", "g2")
    certified = ("g1", "g2", "ball")
    finders: ClassVar[Finders] = {STAMPS: stamp_findings}
    measures: ClassVar[tuple[Callable[[Array, float], Mapping[str, Array]], ...]] = (sine_figures,)
    """Functions that compute figures (...,) by name from angles (..., NODES) rad on a circle of a radius in mm."""
    ranges = frozenset({"band_deg"})
    """Figures biased upwards by noise, which are lowered by its mean contribution."""

    def notes_of(self, result: CircleResult) -> tuple[str, ...]:
        return ()

    def table_of(self, rows: Rows, direction: Direction | None, where: str) -> CircleTable:
        direction = _require_direction(direction, where, "import the table with --direction cw or acw")
        t_s, q, g_mm = (self.read_field(field, rows) for field in ("t_s", "q", "g_mm"))
        return CircleTable(self.test, direction, t_s, q, g_mm, self.read_field("u_t_s", rows))

    def recorded(
        self, data: Aligned, rig: Rig, direction: Direction | None, where: str
    ) -> tuple[CircleTable, list[str]]:
        direction = _require_direction(direction, where, "add the direction: rig relabel RUN --direction acw or cw")
        return CircleTable(self.test, direction, data.t_s, data.q, data.g_mm, data.u_t_s), []

    def evaluate(self, table: CircleTable, rig: Rig, where: str, instruments: Instruments) -> CircleResult:
        gauges = rig.gauges
        if gauges.g2 is None:
            problem = "has a single gauge, but an angle needs two"
            raise FileError(where, problem, "add gauges.g2 to the rig file", code="rig_file.invalid")
        baseline = gauges.baseline_mm, gauges.baseline_u_mm
        laps = laps_of(table, rig, where)
        return self.evaluate_laps(laps, *baseline, instruments.u_lag_s, where, instruments.like)

    def evaluate_laps(
        self,
        laps: Laps,
        baseline_mm: float,
        baseline_u_mm: float,
        u_lag_s: float,
        where: str = "the run",
        like: tuple[LapNoise, LapNoise] | None = None,
    ) -> CircleResult:
        """Figures of a run's laps, ranges corrected for noise.

        like: noise of angle and distance in a different run of the cell, for a run of one lap. Raises FileError for
        readings impossible with a ball link.
        """
        _check_laps(laps, baseline_mm, where)
        run = reduced(laps)
        angle = partial(angle_of_gauges, baseline_mm=baseline_mm)
        curve = curve_of(run, angle, np.sqrt(2) / abs(baseline_mm), 0, like and like[0])
        radius, u_scale = laps.frame.radius, baseline_u_mm / abs(baseline_mm)
        rng = np.random.default_rng(SEED)
        turned = curve.turned(rng.normal(0.0, u_lag_s, DRAWS))
        scale = 1.0 + rng.normal(0.0, u_scale, DRAWS)

        def draw_noise(curves: Sequence[Array]) -> list[Array]:
            return [curve.draw_noise(curves[0], turned, scale)]

        of_angle = figures(lambda y: self.figures_at(y[0], radius), [curve], draw_noise, run.samples, self.ranges)
        sine = fit_sine(curve.y)
        residual = at_resolution(curve.y - sine(PHI))
        distance = evaluate_distance(run, radius, u_lag_s, like and like[1])
        notes = (*laps.notes, *run.notes, *_about_noise(curve))
        count = run.samples
        result = CircleResult(laps, curve.y, residual, sine, of_angle, count, notes, curve, distance, u_lag_s, u_scale)
        return replace(result, notes=(*notes, *self.notes_of(result)))

    def figures_at(self, y: Array, radius_mm: float) -> dict[str, Array]:
        return {name: value for measure in self.measures for name, value in measure(y, radius_mm).items()}

    def plain_figures(self, phi: Array, y: Array, radius_mm: float) -> dict[str, float]:
        """Figures of a noise-free curve y (n,) rad over phi (n,) rad."""
        return {name: float(value) for name, value in self.figures_at(nodes_of(phi, y), radius_mm).items()}

    def require_evaluable(self, table: CircleTable, rig: Rig, where: str) -> None:
        laps_of(table, rig, where)

    def simulated(self, rig: Rig, direction: Direction | None, run: Simulation) -> CircleTable:
        require_test(rig, self.test)
        if direction is None:
            raise FileError(
                f"{self.test} test", "needs a direction", "give --direction cw, acw or both", code="answer.missing"
            )
        laps = circle_laps(rig, direction)
        t_s = np.arange(0.0, laps.end_s, 1.0 / GAUGE_RATE_HZ)
        table = CircleTable(self.test, direction, t_s, laps.at(t_s), np.empty((0, 2)))
        return replace(table, g_mm=read_by_gauges(rig, table, planted_setup(rig), run))

    def setup(self, rig: Rig) -> SetUp:
        return SetUp(np.array(circle_of(rig).centre_mm), np.zeros(2), np.eye(4), np.eye(4))

    def path(self, model: Model, table: CircleTable) -> Path:
        return Path(Motion(table.t_s, table.q), np.arange(len(table.q)))

    def read(self, model: Model, table: CircleTable, path: Path, scene: ModelScene, setup: SetUp) -> Array:
        to_tool = scene.T[:, :3, 3] - setup.ball
        circle = frame_of(circle_of(model.rig))
        offsets = np.array([gauge.offset_mm for _, gauge in model.rig.gauges])
        contact = np.arctan2(to_tool @ circle.v, to_tool @ circle.u)
        scene = apply(model.effects, "setup", replace(scene, contact=contact, offsets_mm=offsets))
        g_mm = link_readings(scene.T, setup.ball, scene.offsets_mm, table.test, circle.radius, scene.form_mm)
        return gauged(model, path, scene, setup, g_mm)

    def unit_findings(self, table: CircleTable, rig: Rig, T_tool: Array) -> Iterable[Finding]:
        return impossible(circle_gauges(table, rig, T_tool))

    def cannot_tell(self, table: CircleTable, rig: Rig) -> str:
        return "" if rig.tests.circle else PLACE_UNKNOWN

    def judged_joints(self, table: CircleTable, rig: Rig) -> Verdict:
        return judged_by_path(table, rig)

    def off_path(self, table: CircleTable, rig: Rig, T_tool: Array) -> PathDeviation | None:
        return off_circle(T_tool, rig.tests.circle) if rig.tests.circle else None

    def rows_used(self, table: CircleTable, rig: Rig, where: str) -> Integers:
        return np.searchsorted(table.t_s, laps_of(table, rig, where).t_s)


class Yaw(Circle):
    """Orientation error about the circle's normal."""

    test = "yaw"
    finders: ClassVar[Finders] = {STAMPS: stamp_findings, ORDER: order_findings}
    """An eccentric ball reveals the order of the gauges."""
    measures = (
        sine_figures,
        eccentricity_figures,
    )

    def notes_of(self, result: CircleResult) -> tuple[str, ...]:
        by_angle, by_distance = result.eccentricities_mm
        apart = float(np.linalg.norm(by_angle - by_distance))
        if apart < max(_APART_MM, _APART * max(float(np.linalg.norm(e)) for e in (by_angle, by_distance))):
            return ()
        return (
            f"the eccentricities by angle and by distance differ by {apart:.2f} mm: the sign, scale or order of the "
            "gauges may be wrong, or the robot has an error of this size",
        )


class Roll(Circle):
    """Orientation error about the circle's tangent."""

    test = "roll"
    measures = (
        sine_figures,
        range_figures,
    )
    ranges = frozenset({"band_deg", "range_deg"})

    def notes_of(self, result: CircleResult) -> tuple[str, ...]:
        height = result.laps.frame.radius * np.tan(result.sine.A)
        note = (
            "roll cannot separate two causes of the offset: the ball is mounted "
            f"{height:.3f} mm off along n, or the gauges have wrong zeros"
        )
        as_yaw, by_distance = result.eccentricities_mm
        size = float(np.linalg.norm(by_distance))
        if size < _CLEAR_MM or np.linalg.norm(as_yaw - by_distance) > _ALIKE * size:
            return (note,)
        as_of_yaw = f"the sine of the angle matches the ball being {size:.2f} mm off centre"
        return note, f"this looks like a yaw run: {as_of_yaw}"


def planted_setup(rig: Rig) -> SetUp:
    ball = np.array(circle_of(rig).centre_mm) + np.array(circle_of(rig).eccentricity_mm)
    return SetUp(ball, np.zeros(2), np.eye(4), np.eye(4))


def angle_of_gauges(g_mm: Array, baseline_mm: float) -> Array:
    """Angle in rad of readings (..., 2) mm. Importable, because curves are pickled."""
    return link_angle(g_mm[..., 0], g_mm[..., 1], baseline_mm)


def _require_direction(direction: Direction | None, where: str, remedy: str) -> Direction:
    if direction is None:
        raise FileError(where, "lacks a direction, which a circle needs", remedy, code="readings.unsuitable")
    return direction


def _check_laps(laps: Laps, baseline_mm: float, where: str) -> None:
    if laps.g_mm.ndim != 2 or laps.g_mm.shape[1] != 2:
        problem = "does not have two gauges, and an angle needs two"
        raise FileError(where, problem, "give g1_mm and g2_mm", code="table.invalid")
    if baseline_mm == 0:
        problem = "the gauges have the same offset_mm, which cannot measure an angle"
        raise FileError(where, problem, "correct offset_mm of g1 and g2 in the rig file", code="rig_file.invalid")
    check_radius(where, laps.frame.radius)
    check_numbers(where, t_s=laps.t_s, q=laps.q, g1_mm=laps.g_mm[:, 0], g2_mm=laps.g_mm[:, 1])
    require_live_gauges(where, g1_mm=laps.g_mm[:, 0], g2_mm=laps.g_mm[:, 1])


def _about_noise(curve: LapCurve) -> tuple[str, ...]:
    if curve.slips:
        sizes = ", ".join(f"{np.degrees(slip):+z.4f}°" for slip in curve.slips)
        why = "which is more than noise and drift explain: check the clamps"
        return (f"the angle steps by {sizes} between laps, {why}",)
    match curve.noise.source:
        case "borrowed":
            why = "the slow noise is taken from a different run of this cell, at an unknown level"
            return (f"the run has one lap: {why}",)
        case "assumed":
            why = "the noise of real cells is assumed; drive two laps"
            return (f"a single lap cannot show slow noise: {why}",)
    return ()
