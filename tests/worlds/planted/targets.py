"""Targets: a hemisphere visited once or more, and repeated approaches from two sides, with scattering stops.

The true value of every figure is computed from its definition in docs/figures.md. Lengths are in mm.
"""

import dataclasses
from dataclasses import dataclass
from functools import cache

import numpy as np

from analysis.procedures.shared.test_kind import evaluate
from analysis.robot.geometry.driven_programs import hemisphere_of, radial_program
from analysis.runs.tables import RadialTable, RepeatabilityTable
from tests.worlds.planted.cells import DRIFT_MM_PER_S, STEPS_MM, between, draw_scatter, student
from tests.worlds.planted.circles import Outcome, Size, Truth, cell_rig
from tests.worlds.planted.closed_forms import directions

STOP_S = 4.0
"""Time between stops."""
AGAIN = 400
"""Number of repetitions of a test for computing expected figures."""
TARGETS, SIDES = 12, ("out", "in")


@dataclass(frozen=True)
class Stops:
    """Scatter of readings at stops: smallest and largest standard deviation of a target's stops, degrees of freedom
    of the t distribution (inf: normal), and errors of the gauge: white noise, resolution, drift, a slip,
    outliers.
    """

    scatter_mm: tuple[float, float] = (0.008, 0.008)
    freedom: float = np.inf
    white_mm: float = 0.0005
    step_mm: float = 0.0001
    drift_mm_per_s: float = 0.0
    slip_mm: float = 0.0
    outliers: float = 0.0

    @property
    def u_gauge_mm(self) -> float:
        """Standard uncertainty of a reading, including rounding."""
        return float(np.hypot(self.white_mm, self.step_mm / np.sqrt(12)))


SINGLE: dict[str, Stops] = {
    "alike": Stops(),
    "unlike": Stops(scatter_mm=(0.005, 0.040)),
    "heavy tails": Stops(freedom=4.0),
    "10 um steps": Stops(step_mm=0.010),
    "outliers": Stops(outliers=0.005, white_mm=0.003),
    "drift": Stops(drift_mm_per_s=DRIFT_MM_PER_S),
    "slip": Stops(slip_mm=0.005),
}


def draw_stops(rng: np.random.Generator, kind: str) -> Stops:
    """Draw the scatter, of a single kind or according to the table, with tails from t(4)."""
    if kind != "table":
        return SINGLE[kind]
    return Stops(
        scatter_mm=draw_scatter(rng),
        freedom=between(rng, 4.0, 30.0),
        white_mm=between(rng, 0.0002, 0.003),
        step_mm=float(rng.choice(STEPS_MM)),
        drift_mm_per_s=rng.uniform(-1, 1) * DRIFT_MM_PER_S,
        outliers=rng.uniform(0, 0.005),
    )


def sigmas(rng: np.random.Generator, stops: Stops, count: int) -> np.ndarray:
    """Standard deviations (t,) of the stops at each target."""
    low, high = np.log(stops.scatter_mm)
    return np.exp(rng.uniform(low, high, count))


def scattered(rng: np.random.Generator, stops: Stops, true_mm: np.ndarray, sigma_mm: np.ndarray) -> np.ndarray:
    """Return readings (..., n) mm of stops with expectations true_mm and standard deviations sigma_mm, last axis in
    time order.

    Drift and slip start with the run, after the gauge was zeroed. They are errors of an absolute length such as the
    radius.
    """
    shape = np.broadcast_shapes(true_mm.shape, sigma_mm.shape)
    law = student(rng, stops.freedom, shape)
    time_s = STOP_S * np.arange(shape[-1])
    creep = stops.drift_mm_per_s * time_s + stops.slip_mm * (time_s > rng.uniform(0.2, 0.8) * time_s[-1])
    return true_mm + sigma_mm * law + creep + rng.normal(0, stops.white_mm, shape)


def read(rng: np.random.Generator, stops: Stops, g_mm: np.ndarray) -> np.ndarray:
    """Return readings (...) mm rounded to the resolution, with outliers of 10 to 100 standard deviations of the
    gauge.
    """
    hit = rng.random(g_mm.shape) < stops.outliers
    size = rng.choice([-1, 1], g_mm.shape) * np.exp(rng.uniform(np.log(10), np.log(100), g_mm.shape))
    return np.asarray(np.round((g_mm + hit * size * stops.u_gauge_mm) / stops.step_mm) * stops.step_mm)


def done_again(rng: np.random.Generator, stops: Stops, true_mm: np.ndarray, sigma_mm: np.ndarray) -> np.ndarray:
    """Return readings (AGAIN, n) mm of repetitions of the same test without outliers, which are not a property of
    the robot.
    """
    readings = scattered(rng, stops, true_mm, np.stack([sigma_mm] * AGAIN))
    return read(rng, dataclasses.replace(stops, outliers=0.0), readings)


def rp(x: np.ndarray) -> np.ndarray:
    """Return RP of ISO 9283, 7.2.2, for visits (..., v, d): mean + 3 S of the distances from their mean."""
    away = np.linalg.norm(x - x.mean(axis=-2, keepdims=True), axis=-1)
    return np.asarray(away.mean(axis=-1) + 3 * away.std(axis=-1, ddof=1))


# --- hemisphere


@cache
def one_visit() -> RadialTable:
    """Hemisphere program of the rig without readings."""
    rig, _ = cell_rig()
    once = hemisphere_of(rig).model_copy(update={"visits": 1})
    program = radial_program(rig.model_copy(update={"tests": rig.tests.model_copy(update={"hemisphere": once})}))
    zeros = np.zeros(len(program.target))
    return RadialTable(program.target, program.polar, program.azimuth, program.orientation, zeros, program.q, zeros)


def visited(visits: int, g_mm: np.ndarray) -> RadialTable:
    """Complete program repeated `visits` times, with readings (visits · n,)."""
    once, time_s = one_visit(), STOP_S * np.arange(len(g_mm))
    again = {f.name: np.concatenate([getattr(once, f.name)] * visits) for f in dataclasses.fields(once)}
    return RadialTable(**again | {"t_s": time_s, "g_mm": g_mm})


def draw_errors(rng: np.random.Generator) -> np.ndarray:
    """Draw expected readings (n,) mm of the program: a radius, a displacement, and errors of each target and
    orientation.
    """
    once = one_visit()
    pull = directions(once) @ rng.normal(0, 0.2, 3)
    of_target, of_orientation = (between(rng, 0.02, 0.3) * rng.normal(size=(once.target.max() + 1, 4)) for _ in "to")
    orientation = of_orientation[once.target, once.orientation]
    return rng.normal(0, 0.1) + pull + of_target[once.target, 0] + orientation


def true_radial(g_mm: np.ndarray) -> Truth:
    """True figures for expected readings (n,) mm of the program."""
    once, radius = one_visit(), hemisphere_of(cell_rig()[0]).radius_mm
    by_target = [once.target == target for target in np.unique(once.target)]
    mean = np.array([g_mm[rows].mean() for rows in by_target])
    spread = np.array([np.ptp(g_mm[rows]) for rows in by_target])
    centre, fitted, off = _sphere((radius + mean)[:, None] * directions(once)[[rows.argmax() for rows in by_target]])
    return {
        "radius_mm": fitted,
        **{f"centre_{axis}_mm": float(x) for axis, x in zip("xyz", centre, strict=True)},
        "band_mm": float(np.ptp(off)),
        "held_radius_mm": float(radius + mean.mean()),
        "held_band_mm": float(np.ptp(mean)),
        "ap_mm": float(np.abs(mean).max()),
        "spread_mm": float(spread.max()),
        "spread_mean_mm": float(spread.mean()),
    }


def _sphere(points: np.ndarray) -> tuple[np.ndarray, float, np.ndarray]:
    """Return centre (3,), radius and residual (n,) of the least-squares sphere through points (n, 3)."""
    from scipy.optimize import least_squares  # noqa: PLC0415 - slow to import

    def left(centre: np.ndarray) -> np.ndarray:
        distance = np.linalg.norm(points - centre, axis=1)
        return distance - distance.mean()

    fit = least_squares(left, np.zeros(3), xtol=1e-15, ftol=1e-15, gtol=1e-15)
    return fit.x, float(np.linalg.norm(points - fit.x, axis=1).mean()), fit.fun


def radial_case(rng: np.random.Generator, kind: str, size: Size) -> Outcome:
    """Return figures of targets visited once per lap. The true RP is the expected value over repetitions of the
    test.
    """
    stops, expected = draw_stops(rng, kind), draw_errors(rng)
    sigma = sigmas(rng, stops, one_visit().target.max() + 1)[one_visit().target]
    g = scattered(rng, stops, np.tile(expected, size.laps), np.tile(sigma, size.laps))
    table = visited(size.laps, read(rng, stops, g))
    truth = true_radial(expected)
    if size.laps >= 2:
        again = done_again(rng, stops, np.tile(expected, size.laps), np.tile(sigma, size.laps))
        each = rp(again.reshape(AGAIN, size.laps, -1).swapaxes(1, 2)[..., None])
        truth |= {"rp_mm": float(each.max(axis=1).mean()), "rp_mean_mm": float(each.mean())}
    figures = evaluate(table, cell_rig()[0], 0.0, "planted", u_gauge_mm=stops.white_mm).figures
    return {f"radial, {size.laps} visit{'s' * (size.laps > 1)}": (dict(figures), truth)}


# --- repeatability


def repeatability_figures(x: np.ndarray) -> dict[str, np.ndarray]:
    """Return figures (...,) of readings x (..., targets, 2, rounds) mm, from outside and inside."""
    uni, bi = np.ptp(x, axis=-1), np.ptp(x.reshape(*x.shape[:-2], -1), axis=-1)
    each, s = rp(x[..., None]), x.std(axis=-1, ddof=1)
    B = x[..., 1, :].mean(axis=-1) - x[..., 0, :].mean(axis=-1)
    r = np.maximum(2 * s.sum(axis=-1) + np.abs(B), 4 * s.max(axis=-1))
    return {
        "uni_mm": uni.max(axis=(-2, -1)),
        "uni_mean_mm": uni.mean(axis=(-2, -1)),
        "bi_mm": bi.max(axis=-1),
        "bi_mean_mm": bi.mean(axis=-1),
        "rp_mm": each.max(axis=(-2, -1)),
        "rp_mean_mm": each.mean(axis=(-2, -1)),
        "r_out_mm": 4 * s[..., 0].max(axis=-1),
        "r_in_mm": 4 * s[..., 1].max(axis=-1),
        "r_mm": r.max(axis=-1),
        "reversal_mm": np.abs(B).max(axis=-1),
        "reversal_mean_mm": B.mean(axis=-1),
    }


def repeatability_case(rng: np.random.Generator, kind: str, size: Size) -> Outcome:
    """Return figures of three rounds, or five for three laps. True values are expectations over repetitions of the
    complete test on the same robot.
    """
    stops, rounds = draw_stops(rng, kind), 5 if size.laps >= 3 else 3
    sigma = np.repeat(sigmas(rng, stops, TARGETS), 2 * rounds)
    B = rng.choice([-1, 1]) * np.exp(rng.uniform(np.log(0.02), np.log(1.4), TARGETS))
    # In time order: target, round, side.
    middle = np.broadcast_to(B[:, None, None] * np.array([-0.5, 0.5]), (TARGETS, rounds, 2)).ravel()
    by_round = (TARGETS, rounds, 2)
    g = read(rng, stops, scattered(rng, stops, middle, sigma))
    again = done_again(rng, stops, middle, sigma)
    every = repeatability_figures(again.reshape(AGAIN, *by_round).swapaxes(-1, -2))
    target, round_, side = (index.ravel() for index in np.indices(by_round))
    q = one_visit().q[one_visit().orientation == 2][target]
    approach = np.array(SIDES)[side]
    table = RepeatabilityTable(target + 1, approach, round_ + 1, STOP_S * np.arange(len(g)), q, g)
    figures = evaluate(table, cell_rig()[0], 0.0, "planted", u_gauge_mm=stops.white_mm).figures
    return {f"repeatability, {rounds} rounds": (dict(figures), {n: float(v.mean()) for n, v in every.items()})}
