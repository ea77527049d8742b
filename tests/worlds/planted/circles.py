"""Circles: a robot with backlash, gear errors and smooth errors drives laps in a noisy cell, and the run is
evaluated.
"""

import dataclasses
from dataclasses import dataclass
from functools import cache
from hashlib import sha256
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from analysis.procedures import direction_pair
from analysis.procedures.circle import CircleResult, Roll, Yaw, distance_figures_at
from analysis.procedures.pooled import pooled
from analysis.procedures.results import Result, result_of
from analysis.procedures.shared.lap_curve import nodes_of
from analysis.procedures.shared.quantity import Quantity
from analysis.robot.geometry.circle import SENSE, frame_of
from analysis.robot.geometry.driven_programs import circle_of, drive
from analysis.robot.kinematics.arm import arm_of
from analysis.runs.loading import Measured
from analysis.runs.tables import CircleTable
from rigs.errors import FileError
from rigs.load import load
from rigs.rig import Rig
from rigs.schema.vocabulary import Direction
from tests.worlds.planted.cells import (
    LAP_S,
    Noise,
    between,
    disturbed,
    draw_cell,
    draw_run,
    gauge_times,
    noise_of,
    rows,
)
from tests.worlds.planted.closed_forms import BASELINE_MM, RADIUS_MM, link_readings

FINE = np.linspace(0, 2 * np.pi, 7200, endpoint=False)
"""Circle angles of a noise-free curve, rad."""
SPEED_RAD_S = 2 * np.pi / LAP_S

Truth = dict[str, float]
Figures = dict[str, Quantity]
Outcome = dict[str, tuple[Figures, Truth]]
"""Figures and their true values by the name of the test."""


@dataclass(frozen=True)
class Errors:
    """Errors of a robot at FINE for acw and cw, (7200,) mm at a gauge."""

    acw: np.ndarray
    cw: np.ndarray

    def at(self, phi: np.ndarray, sense: float) -> np.ndarray:
        """Errors (n,) mm at phi (n,) rad of any lap."""
        return np.interp(phi, FINE, self.acw if sense > 0 else self.cw, period=2 * np.pi)


def draw_errors(rng: np.random.Generator) -> Errors:
    """Draw harmonics (about 10 to 60 µm at order 2, decreasing to 0.7 µm at orders 16 to 32), two gear waves, and
    backlash of five joints that reverse twice per lap.
    """
    order = np.arange(2, 61)
    size = between(rng, 0.010, 0.060) * (2 / order) ** 1.4 * rng.normal(size=len(order))
    smooth = np.cos(FINE[:, None] * order + rng.uniform(0, 2 * np.pi, len(order))) @ size
    for gear in rng.integers(8, 121, 2):
        smooth += between(rng, 0.0003, 0.003) * np.cos(gear * FINE + rng.uniform(0, 2 * np.pi))
    acw, cw = smooth.copy(), smooth.copy()
    for _ in range(5):
        begin, inside = rng.uniform(0, 2 * np.pi), rng.uniform(0.5, 5.5)
        width, transit = between(rng, 0.001, 0.040), np.radians(between(rng, 0.3, 6.0))
        acw += width * _play(FINE - begin, inside, transit)
        cw -= width * _play(FINE - begin + transit, inside, transit)
    return Errors(acw, cw)


def _play(ahead: np.ndarray, inside: float, transit: float) -> np.ndarray:
    """A backlash of width 1 (n,): +1/2 for `inside` rad after the zero of `ahead` (n,) rad, -1/2 elsewhere.

    It is crossed over `transit` after each reversal, which is on the other side for cw.
    """
    ahead = ahead % (2 * np.pi)
    return np.asarray(np.clip(ahead / transit, 0, 1) - np.clip((ahead - inside) / transit, 0, 1) - 0.5)


@dataclass(frozen=True)
class SetUp:
    """Robot and set-up of a run: ball (3,) mm relative to the centre, zeros (2,) mm and true baseline of the gauges,
    errors of the robot, and changes since another run: harmonics of order 0 to 2, cosines and sines (2, 3, 2), of
    the angle in rad and of the distance in mm.
    """

    ball_mm: np.ndarray
    zeros_mm: np.ndarray
    baseline_mm: float
    angle: Errors
    distance: Errors
    moved: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros((2, 3, 2)))

    def readings(self, phi: np.ndarray, sense: float, test: str) -> np.ndarray:
        """Return noise-free readings (n, 2) mm at phi (n,) rad."""
        turns = phi[:, None] * np.arange(3)
        turned, away = (np.cos(turns) @ part[:, 0] + np.sin(turns) @ part[:, 1] for part in self.moved)
        angle = self.angle.at(phi, sense) / (BASELINE_MM / 2) + turned
        distance = self.distance.at(phi, sense) + away
        return link_readings(phi, self.ball_mm, test, angle, distance, self.baseline_mm) - self.zeros_mm

    def curves(self, sense: float, test: str) -> tuple[np.ndarray, np.ndarray]:
        """Return angle (7200,) rad and distance (7200,) mm at FINE."""
        g = self.readings(FINE, sense, test)
        return np.arctan((g[:, 1] - g[:, 0]) / self.baseline_mm), g.mean(axis=1)


def draw_set_up(rng: np.random.Generator) -> SetUp:
    eccentricity, towards = between(rng, 0.05, 3.0), rng.uniform(0, 2 * np.pi)
    ball = np.array([eccentricity * np.cos(towards), eccentricity * np.sin(towards), rng.normal(0, 0.5)])
    baseline = BASELINE_MM + rng.normal(0, cell_rig()[0].gauges.baseline_u_mm)
    return SetUp(ball, rng.normal(0, 0.02, 2), baseline, draw_errors(rng), draw_errors(rng))


# --- truth: figures of the noise-free curve


def true_figures(set_up: SetUp, sense: float, test: str) -> tuple[Truth, Truth]:
    """True figures of the angle and of the distance, each with its reported names."""
    angle, distance = set_up.curves(sense, test)
    of_angle = (Yaw() if test == "yaw" else Roll()).plain_figures(FINE, angle, RADIUS_MM)
    plain = distance_figures_at(nodes_of(FINE, distance), RADIUS_MM)
    return of_angle, {f"distance_{name}" if name in of_angle else name: float(value) for name, value in plain.items()}


def true_pair(set_up: SetUp, lag_s: float) -> Truth:
    both = [set_up.curves(sense, "yaw") for sense in SENSE.values()]
    nodes = np.stack([nodes_of(FINE, curve[k]) for k in (0, 1) for curve in both])
    figures = direction_pair.figures_at(nodes, RADIUS_MM)
    return {name: float(value) for name, value in figures.items()} | {"lag_ms": 1e3 * lag_s}


# --- runs


@cache
def cell_rig() -> tuple[Rig, np.ndarray]:
    """A rig with a circle of RADIUS_MM, and the joints (721, 6) rad of a lap in steps of half a degree."""
    rig, _ = load("paper-fanuc")
    circle = circle_of(rig)
    assert (circle.radius_mm, rig.gauges.baseline_mm, circle.start_deg) == (RADIUS_MM, BASELINE_MM, 0.0)
    phi = np.radians(np.linspace(0, 360, 721))
    return rig, drive(arm_of(rig.robot), frame_of(circle), phi, np.radians(circle.posture_deg), "planted")


@cache
def _joint_wave() -> tuple[Any, np.ndarray]:
    """A periodic spline of the joints without their full turns, and these turns (6,) rad per lap."""
    from scipy.interpolate import CubicSpline  # noqa: PLC0415 - slow to import

    lap = cell_rig()[1]
    whole = 2 * np.pi * np.round((lap[-1] - lap[0]) / (2 * np.pi))
    share = np.linspace(0, 1, len(lap))
    wave = lap - share[:, None] * whole
    wave[-1] = wave[0]
    return CubicSpline(2 * np.pi * share, wave, bc_type="periodic"), whole


def joints(phi: np.ndarray) -> np.ndarray:
    """Return joint angles (n, 6) rad at phi (n,) rad of any lap; a joint with a full turn per lap continues to turn."""
    wave, whole = _joint_wave()
    return np.asarray(wave(phi % (2 * np.pi)) + phi[:, None] / (2 * np.pi) * whole)


@dataclass(frozen=True)
class Size:
    """Laps per run and rows per lap."""

    laps: int
    rows: int


def circle_table(
    rng: np.random.Generator, set_up: SetUp, noise: Noise, test: str, direction: Direction, size: Size
) -> CircleTable:
    """A run: consecutive laps between lead-in and lead-out."""
    sense, lead = SENSE[direction], np.radians(circle_of(cell_rig()[0]).lead_deg)
    t_s = rows(rng, noise, size.laps * LAP_S + 2 * lead / SPEED_RAD_S, LAP_S / size.rows)
    true_s, shown, u_t_s = gauge_times(rng, noise, t_s)
    at = sense * (SPEED_RAD_S * true_s - lead)
    g = np.stack([set_up.readings(at[:, k], sense, test)[:, k] for k in (0, 1)], axis=1)
    g += np.take_along_axis(noise_of(rng, noise, t_s), shown, axis=0)
    q = joints(sense * (SPEED_RAD_S * t_s - lead))
    return CircleTable(test, direction, t_s, q, disturbed(rng, noise, g), u_t_s)  # type: ignore[arg-type]


def circle_result(table: CircleTable, u_lag_s: float) -> Result:
    """Evaluate the table like a run from disk."""
    name = f"{table.test}-{table.direction}"
    recording = (sha256(table.g_mm.tobytes()).hexdigest(),)
    manifest = SimpleNamespace(name=name, test=table.test, direction=table.direction)
    run: Any = SimpleNamespace(manifest=manifest, readings_sha256=recording)
    return result_of(Measured(Path(name), run, cell_rig()[0], table, u_lag_s, ()))


# --- cases


def yaw_case(rng: np.random.Generator, kind: str, size: Size) -> Outcome:
    """Return figures of an acw and a cw yaw run: angle and distance of one run, and the pair."""
    set_up, cell = draw_set_up(rng), draw_cell(rng, kind)
    tables = [circle_table(rng, set_up, draw_run(rng, cell, kind), "yaw", way, size) for way in SENSE]
    results = acw, cw = [circle_result(table, cell.u_lag_s) for table in tables]
    one = results[int(rng.integers(2))]
    angle, distance = true_figures(set_up, SENSE[one.measured.table.direction], "yaw")  # type: ignore[union-attr]
    assert isinstance(acw.found, CircleResult) and isinstance(cw.found, CircleResult)
    both = direction_pair.pair(acw.found, cw.found)
    return {
        "yaw": ({name: figure for name, figure in one.figures.items() if name not in distance}, angle),
        "circularity": ({name: figure for name, figure in one.figures.items() if name in distance}, distance),
        "pair": ({**both.figures, "lag_ms": both.lag}, true_pair(set_up, cell.lag_s)),
    }


def roll_case(rng: np.random.Generator, kind: str, size: Size) -> Outcome:
    """Return figures of the angle of a roll run; the distance is covered by yaw."""
    set_up, cell = draw_set_up(rng), draw_cell(rng, kind)
    way: Direction = "acw" if rng.random() < 0.5 else "cw"
    table = circle_table(rng, set_up, draw_run(rng, cell, kind), "roll", way, size)
    angle, distance = true_figures(set_up, SENSE[way], "roll")
    figures = circle_result(table, cell.u_lag_s).figures
    return {"roll": ({name: figure for name, figure in figures.items() if name not in distance}, angle)}


# --- repeated runs: differences between them

REACH_MM = 900.0
"""Distance from base to circle, the lever of a joint error."""


@dataclass(frozen=True)
class Between:
    """Differences between runs of a cell: standard deviations of the joints (6,) rad and of the ball in mm; by_joint
    (6, 2, 3, 2): harmonics of `SetUp.moved` per rad of a joint.
    """

    joint_rad: np.ndarray
    ball_mm: float
    by_joint: np.ndarray

    def another(self, rng: np.random.Generator, set_up: SetUp) -> SetUp:
        moved = np.tensordot(rng.normal(0, self.joint_rad), self.by_joint, axes=1)
        return dataclasses.replace(set_up, ball_mm=set_up.ball_mm + rng.normal(0, self.ball_mm, 3), moved=moved)


def draw_between(rng: np.random.Generator) -> Between:
    """Draw the scatter of joints, 0.0003 to 0.005°, and of the ball, 1 to 20 µm.

    The effect of a joint varies smoothly along the lap; a displacement across the link, divided by the radius, turns
    it.
    """
    joint_rad = np.radians(np.exp(rng.uniform(np.log(0.0003), np.log(0.005), 6)))
    lever = REACH_MM * rng.normal(size=(6, 2, 3, 2)) / np.array([2.0, 4.0, 8.0])[:, None]
    return Between(joint_rad, between(rng, 0.001, 0.020), lever / np.array([RADIUS_MM, 1.0])[:, None, None])


def repeated_runs(
    rng: np.random.Generator, kind: str, size: Size, count: int
) -> tuple[list[CircleTable], Noise, SetUp, Between]:
    """Return `count` anticlockwise yaw runs on a circle, with their noise, set-up and differences."""
    set_up, cell, differs = draw_set_up(rng), draw_cell(rng, kind), draw_between(rng)
    tables = [
        circle_table(rng, differs.another(rng, set_up), draw_run(rng, cell, kind), "yaw", "acw", size)
        for _ in range(count)
    ]
    return tables, cell, set_up, differs


def mean_figures(rng: np.random.Generator, set_up: SetUp, differs: Between) -> Truth:
    """Expected yaw figures over all possible runs."""
    every = [true_figures(differs.another(rng, set_up), 1.0, "yaw") for _ in range(150)]
    angle, distance = ({name: np.array([e[k][name] for e in every]) for name in every[0][k]} for k in (0, 1))
    return {name: _mean(name, values) for name, values in (angle | distance).items()}


def _mean(name: str, values: np.ndarray) -> float:
    if name.endswith(("_at_deg", "shift_deg")):
        return float(np.degrees(np.angle(np.exp(1j * np.radians(values)).mean())))
    return float(values.mean())


def repeated_case(rng: np.random.Generator, kind: str, size: Size) -> Outcome:
    """Pooled figures of two, three or five runs: mean ± standard uncertainty of the mean."""
    count = int(rng.choice([2, 3, 5]))
    tables, cell, set_up, differs = repeated_runs(rng, kind, size, count)
    (together,) = pooled([circle_result(table, cell.u_lag_s) for table in tables])
    if len(together.runs) < count:
        raise FileError("planted", "runs of one set-up were left out of their mean", "see why")
    figures = {name: figure.mean for name, figure in together.figures.items()}
    return {f"{count} runs": (figures, mean_figures(rng, set_up, differs))}
