"""Inverted or exchanged gauges: with both negated every size and every sign is the opposite, and most runs look
plausible.

Two facts reveal the sign and the order: a joint with backlash lags behind the drive, and never leads; and an error
known to the rig file. Both are compared with the readings as labelled and as possibly meant. If the arm has no
backlash, and the rig file no effect, the data do not show it.

Circles that repeat each other show swapped cables or columns. An exchange does not change the mean of the gauges, and
it reverses the sign of their difference. Another sign reverses both. A moved ball changes both too, but only in the
first order of the circle: the sign of both is judged by the higher orders.

Signs of an exchange within a single yaw run cause a doubt, and never a refusal. The distance, the mean of the gauges,
and the angle between them show the same eccentricity e of the ball. If exchanged, the angle shows -e: the two differ by
2 |e|. An error of the arm that rotates the tool in the first order of the circle also moves either of them, and a ball
is set within a millimetre while a large fault moves it by millimetres: no evaluation of a single run distinguishes the
two with certainty. But such an error has other orders too; an exchange is therefore likely if the two differ by more
than the rest of the readings explains.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from analysis.procedures.checks.checks_of_test import checks_of, findings_against
from analysis.procedures.checks.finding import Finding, Misfit, Strength
from analysis.procedures.prediction import nominal_setup, path_of, read
from analysis.robot.geometry.circle import frame_of, link_angle, link_readings
from analysis.robot.geometry.driven_programs import circle_of
from analysis.robot.kinematics.arm import Array, arm_of, forward
from analysis.robot.model.predict import Model, model_of, moved
from analysis.runs.laps import is_on_circle, laps_of
from analysis.runs.loading import Measured
from analysis.runs.noise.readings import rms
from analysis.runs.table_format import format_of
from analysis.runs.tables import CircleTable, Table
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.scene import play
from rigs.schema.vocabulary import TestName

ORDER, SIGN = "gauge order", "gauge sign"
EXCHANGED = "g1 and g2 may be exchanged"
_ORDER_ROWS = 5000
"""Number of rows sufficient to show the first order of a run."""
_WHOLE = 0.9
"""Share of a lap from which on the first order is determined."""
_CLOSER = 0.5
"""The two eccentricities lie closer by this factor with the gauges exchanged."""
_BEYOND = 2.0
"""Minimum distance between them as a multiple of the rms of all other orders. Both factors are chosen: `scripts/dev
exchanged` counts wrong doubts and missed exchanges."""
_SEEN_MM, _NEGATED = 0.2, 0.25
"""With a single gauge negated the two eccentricities agree within this share, and are visible above this size.
Chosen: an error of the arm imitates this only by chance, in size and in direction."""


def order_findings(table: CircleTable, rig: Rig) -> Iterator[Finding]:
    """Yield a finding if g1 and g2 of a yaw run appear exchanged, or either of them inverted, by the two
    eccentricities for each meaning of the columns."""
    circle = rig.tests.circle
    if circle is None or rig.gauges.g2 is None:
        return
    rows = slice(None, None, max(1, len(table.q) // _ORDER_ROWS))
    frame, places = frame_of(circle), forward(arm_of(rig.robot), table.q[rows])[:, :3, 3]
    on = is_on_circle(places, frame) & np.isfinite(table.g_mm[rows]).all(axis=1)
    if table.g_mm.shape[1] < 2 or not on.any():
        return
    phi, g_mm = frame.angle(places[on]), table.g_mm[rows][on, :2]
    if np.ptp(phi) < _WHOLE * 2 * np.pi:
        return
    labelled, exchanged, first, second = (
        _Eccentricities.of(phi, g_mm[:, columns] * signs, circle.radius_mm, rig.gauges.baseline_mm)
        for columns, signs in (((0, 1), (1, 1)), ((1, 0), (1, 1)), ((0, 1), (-1, 1)), ((0, 1), (1, -1)))
    )
    if labelled.apart_mm < _BEYOND * labelled.rest_mm:
        return
    if exchanged.apart_mm <= _CLOSER * labelled.apart_mm:
        (u, v), (angle_u, angle_v) = labelled.by_distance, labelled.by_angle
        fact = (
            f"g1 and g2 may be exchanged, which reverses every angle: the ball is ({u:.2f}, {v:.2f}) mm off centre by "
            f"their mean, ({angle_u:.2f}, {angle_v:.2f}) mm by their difference"
        )
        remedy = (
            "press a probe to see which is which, and exchange their columns or ports; if they are right, the robot "
            "has an error of this size"
        )
        yield Finding(ORDER, "likely", ("g1_mm", "g2_mm"), EXCHANGED, fact, remedy)
    elif labelled.size_mm > _SEEN_MM:
        for number, meaning_of_sign in ((1, first), (2, second)):
            if meaning_of_sign.apart_mm <= _NEGATED * meaning_of_sign.size_mm and labelled.apart_mm > labelled.size_mm:
                name, second_name = f"g{number}", f"g{3 - number}"
                fact = (
                    f"{name} may count in the opposite direction to {second_name}: only then do the mean and "
                    "the difference of the gauges agree on the place of the ball"
                )
                remedy = f"press both probes and compare their directions; correct counts of {name} in the rig file, "
                remedy += "or change its sign"
                yield Finding(SIGN, "likely", (f"{name}_mm",), negated(number), fact, remedy)


@dataclass(frozen=True)
class _Eccentricities:
    """Eccentricity of the ball, (2,) mm along phi = 0° and 90°, by the mean of two gauges and by the angle between
    them; rest_mm: rms of the remaining readings."""

    by_distance: Array
    by_angle: Array
    rest_mm: float

    @property
    def apart_mm(self) -> float:
        """Distance between the two eccentricities."""
        return float(np.linalg.norm(self.by_angle - self.by_distance))

    @property
    def size_mm(self) -> float:
        """Mean size of the two eccentricities."""
        return float(np.linalg.norm(self.by_angle + self.by_distance)) / 2

    @classmethod
    def of(cls, phi: Array, g_mm: Array, radius_mm: float, baseline_mm: float) -> _Eccentricities:
        """Return the eccentricities from circle angles phi (n,) rad and readings g_mm (n, 2); angles times the
        radius, both in mm."""
        by_gauges = link_angle(g_mm[:, 0], g_mm[:, 1], baseline_mm)
        seen = np.stack([g_mm.mean(axis=1), radius_mm * by_gauges], axis=1)
        waves = np.stack([np.ones_like(phi), np.cos(phi), np.sin(phi)], axis=1)
        fit = np.linalg.lstsq(waves, seen, rcond=None)[0]
        rms_mm = float(np.sqrt(np.mean((seen - waves @ fit) ** 2) * 2))
        return cls(-fit[1:, 0], np.array([-fit[2, 1], fit[1, 1]]), rms_mm)


def negated(number: int) -> str:
    """Return the possible meaning of a negated gauge, 1 or 2."""
    return f"g{number} may count the other way"


GRID = 256
"""Circle angles to which laps are interpolated for comparison."""
_LEAST_MM = 0.05
"""Smallest difference from the repeats that is examined: joints of real cells repeat to 0.005°, which moves gauges 50
mm apart by 0.01 mm, and the limit is five times that."""
_CLEAR = 4.0
"""Factor by which the difference must fit better with the sign reversed, and by which the mean must fit better
unchanged. Chosen: far from the factor of 1 caused by noise."""


@dataclass(frozen=True)
class Lap:
    """A circle run on the grid: mean and difference of the gauges (GRID,) mm, each with the mean subtracted."""

    run: Measured
    mean: Array
    apart: Array

    @property
    def place(self) -> tuple[object, ...]:
        """Common properties of runs with the same ball: test, circle and placement."""
        manifest = self.run.run.manifest
        return (manifest.test, manifest.placement, self.run.rig.tests.circle, self.run.rig.robot)


def laps_on_grid(runs: Iterable[Measured]) -> list[Lap]:
    """Return the circle runs with two gauges, on the grid; runs with no lap are reported by the analysis."""
    laps_of_runs = []
    for run in runs:
        with suppress(FileError):
            if isinstance(run.table, CircleTable) and run.table.g_mm.shape[1] == 2:
                laps = laps_of(run.table, run.rig, str(run.path))
                g_mm = gridded(laps.phi, laps.g_mm)
                g_mm -= g_mm.mean(axis=0)
                laps_of_runs.append(Lap(run, g_mm.mean(axis=1), g_mm[:, 1] - g_mm[:, 0]))
    return laps_of_runs


def gridded(phi: Array, values: Array) -> Array:
    """Return values (n, k) at circle angles phi (n,) rad as means (GRID, k) about the angles of the grid,
    interpolated between neighbours in gaps."""
    place = np.round(phi * GRID / (2 * np.pi)).astype(int) % GRID
    count = np.bincount(place, minlength=GRID)
    filled = np.flatnonzero(count)
    means = [np.bincount(place, column, GRID)[filled] / count[filled] for column in values.T]
    return np.stack([np.interp(np.arange(GRID), filled, mean, period=GRID) for mean in means], axis=1)


def repeat_findings(runs: Sequence[Measured]) -> Iterator[Finding]:
    """Yield findings about runs that contradict their repeats. If two equal halves of the repeats contradict each
    other, the half contradicting the circles of the other direction is reported."""
    laps = laps_on_grid(runs)
    groups: dict[tuple[object, ...], list[Lap]] = {}
    for lap in laps:
        direction = lap.run.run.manifest.direction
        group_of_lap = next(
            (group for (way, *_), group in groups.items() if way == direction and group[0].place == lap.place), None
        )
        if group_of_lap is None:
            groups[(direction, len(groups))] = [lap]
        else:
            group_of_lap.append(lap)
    for group in groups.values():
        direction = group[0].run.run.manifest.direction
        reverse = [lap for lap in laps if lap.place == group[0].place and lap.run.run.manifest.direction != direction]
        yield from _contradicting(group, reverse)


def _contradicting(repeats: Sequence[Lap], reverse: Sequence[Lap]) -> Iterator[Finding]:
    """Yield findings about repeats with the opposite sign of the difference to most of them."""
    mean, apart = np.array([lap.mean for lap in repeats]), np.array([lap.apart for lap in repeats])
    sign = np.where(np.linalg.eigh(apart @ apart.T)[1][:, -1] < 0, -1.0, 1.0)
    if abs(sign.sum()) > 0:
        sign *= np.sign(sign.sum())
    elif reverse:
        sign *= np.sign(float((sign @ apart) @ sum(lap.apart for lap in reverse))) or 1.0
    else:
        return
    most = sign > 0
    usual, usual_apart = mean[most].mean(axis=0), apart[most].mean(axis=0)
    for k in np.flatnonzero(~most).tolist():
        as_labelled, as_meant = rms(apart[k] - usual_apart), rms(apart[k] + usual_apart)
        if as_labelled > max(_LEAST_MM, _CLEAR * as_meant, _CLEAR * rms(mean[k] - usual)):
            yield _finding(repeats[k], as_labelled, as_meant, negated=False)
            continue
        spectra = np.fft.rfft([apart[k], usual_apart, mean[k], usual])
        spectra[:, 1] = 0.0  # the first order may be another position of the ball
        shapes = np.fft.irfft(spectra, n=GRID)
        as_labelled, as_meant = (
            float(np.hypot(rms(shapes[0] - side * shapes[1]), rms(shapes[2] - side * shapes[3])))
            for side in (1.0, -1.0)
        )
        if as_labelled > max(_LEAST_MM, _CLEAR * as_meant):
            yield _finding(repeats[k], as_labelled, as_meant, negated=True)


def _finding(lap: Lap, as_labelled: float, as_meant: float, *, negated: bool) -> Finding:
    name = lap.run.run.manifest.name
    misfit = Misfit(as_labelled, as_meant, GRID / 4 * float(np.log(as_labelled / max(as_meant, 1e-6))))
    if negated:
        fact = "the gauges g1 and g2 count in the opposite direction to the repeats of this run"
        remedy = "set counts: towards in the rig file, or import the run with both signs changed"
        return Finding(SIGN, "decisive", ("g1_mm", "g2_mm"), "g1 and g2 negated", fact, remedy, misfit, (name,))
    fact = "the gauges g1 and g2 are exchanged compared with the repeats of this run"
    remedy = "check the cables, or import the run with the columns exchanged"
    return Finding(ORDER, "decisive", ("g1_mm", "g2_mm"), "g1 and g2 exchanged", fact, remedy, misfit, (name,))


_ALIKE = 8.0
"""Steps of the grid, of 1.4° each, over which the remaining curves of two laps agree: they count as a single
reading."""
_DECISIVE = 12.0
"""Log-likelihood from which the sign of a play is proof, odds of 160 000 to 1: drift and waves are no white noise."""
_FITS, _FITS_WELL = 4.0, 6.0
"""… and minimum ratio of the energies remaining after backlash. Meanings within the first factor are equivalent;
below the second, which leaves two fifths of the readings, the other meaning does not fit either, and causes a
doubt only."""
_RESOLVED_MM = 0.003
"""Lower limit of the rms remaining after backlash as labelled: the resolution of gauges of 1 µm."""
_PLAY_RAD = float(np.radians(0.01))
"""Width by which a joint has turned back: real plays are wider, encoders' noise is narrower."""
_KNOWN = 4.0
"""Factor by which negated readings must fit the effects of the rig file better. An arm that changed does not change to
the opposite."""
_KNOWN_MM = 0.02
"""Readings that the rig file leaves within this are right as they are."""
_ROWS = 1500
_STEP = 1e-4


def sign_findings(runs: Sequence[Measured]) -> Iterator[Finding]:
    """Yield findings against the sign of the gauges of runs of a robot."""
    gauged = [run for run in runs if format_of(run.table.test).gauges]
    groups: list[list[Measured]] = []
    for run in gauged:
        cell = run.rig.gauges, run.rig.robot
        group_of_run = next((group for group in groups if (group[0].rig.gauges, group[0].rig.robot) == cell), None)
        if group_of_run is None:
            groups.append([run])
        else:
            group_of_run.append(run)
    for group in groups:
        by_effects = [finding for run in group for finding in _known_effects(run)]
        yield from by_effects
        if not by_effects:
            yield from _leading_play(group)


def _known_effects(run: Measured) -> Iterator[Finding]:
    """Yield a run that the effects of the rig file explain only with the gauges negated."""
    model = model_of(run.rig)
    table = run.table
    if not model.effects or not format_of(table.test).gauges or checks_of(table.test).cannot_tell(table, run.rig):
        return
    as_labelled, as_meant = _left_mm(model, table, 1.0), _left_mm(model, table, -1.0)
    if as_labelled < _KNOWN_MM or as_labelled < _KNOWN * as_meant:
        return
    values = 3 * len(table.q) ** 0.5
    misfit = Misfit(as_labelled, as_meant, values * float(np.log(as_labelled / max(as_meant, 1e-6))))
    name, gauges = run.run.manifest.name, tuple(f"{gauge}_mm" for gauge in format_of(table.test).gauges)
    fact = (
        f"the effects of the rig file explain the readings only if the gauges count in the opposite direction (error "
        f"{1e3 * as_meant:.0f} instead of {1e3 * as_labelled:.0f} µm)"
    )
    yield Finding(SIGN, "decisive", gauges, "gauges negated", fact, _REMEDY, misfit, (name,))


_COLUMNS = ("g1_mm", "g2_mm")
_EXCHANGE = "press a probe to see which is which, and exchange their columns or ports"
_REMEDY = "press a probe: if its reading falls, set counts: towards in the rig file, or change the sign of its column"


def _left_mm(model: Model, table: Table, sign: float) -> float:
    """Return the residual of readings with a sign for a model, rms mm, with ball and zeros fitted."""
    setup = nominal_setup(model.rig, table)
    path = path_of(model, table)
    scene = moved(model, path)

    def at(ball: Array) -> Array:
        place = type(setup)(ball, setup.zeros_mm, setup.T_instrument_world, setup.T_tool_target)
        return read(model, table, path, scene, place)

    predicted = at(setup.ball)
    screened_rows = slice(None, None, max(1, len(predicted) // _ROWS))
    slopes = [(at(setup.ball + step) - predicted)[screened_rows].ravel() / 0.01 for step in 0.01 * np.eye(3)]
    count = predicted.shape[1]
    zeros = [np.tile(unit, len(predicted[screened_rows])) for unit in np.eye(count)]
    seen = sign * table.readings
    residual = (seen - predicted)[screened_rows].ravel()
    finite = np.isfinite(residual)
    design = np.stack([*slopes, *zeros], axis=1)[finite]
    residual = residual[finite] - design @ np.linalg.lstsq(design, residual[finite], rcond=None)[0]
    return rms(residual)


@dataclass(frozen=True)
class _Way:
    """Laps of a direction on the grid: readings (GRID, 2) mm, angles as unit vectors, cosine and sine (GRID, 12),
    for a mean modulo a turn, speeds (GRID, 6) rad/s, flank of each joint (GRID, 6) and of each gauge (GRID, 2),
    -1 to 1, and the time (GRID,) since the start, 0 to 1."""

    g_mm: Array
    heading: Array
    speed: Array
    flank: Array
    stuck: Array
    since: Array


def _leading_play(runs: Sequence[Measured]) -> Iterator[Finding]:
    """Yield circles driven both ways in which joints lead at reversals as the gauges are labelled, and lag with
    another meaning: all runs of these gauges are doubtful."""
    if {run.run.manifest.direction for run in runs} < {"acw", "cw"}:
        return
    energies, values = np.zeros(len(_MEANT)), 0.0
    for rig, test, both in _pairs(runs):
        acw, cw = (_mean(both[way]) for way in ("acw", "cw"))
        slopes = _slopes(rig, test, acw, cw)
        energies += [_left_of_plays(slopes, _as(acw, meant), _as(cw, meant)) for meant in _MEANT]
        values += 2 * GRID / _ALIKE
    if not values or not energies.all():
        return
    best = int(np.argmin(energies))
    labelled, least = float(energies[0]), float(energies[best])
    gain = values / 2 * float(np.log(labelled / least))
    as_labelled, as_meant = (float(np.sqrt(energy / (values * _ALIKE))) for energy in (labelled, least))
    if gain < _DECISIVE or labelled < _FITS * least or as_labelled < _RESOLVED_MM:
        return
    # Backlash does not distinguish these; the mean and difference of the gauges showing the same ball position decide.
    alike = [meant for meant, energy in zip(_MEANT, energies, strict=True) if energy < _FITS * least]
    seen = {finding.meant for run in runs for finding in findings_against(ORDER, run.table, run.rig)}
    if EXCHANGED in seen:
        alike = [meant for meant in alike if meant.columns == (1, 0)] or alike
    else:
        signs = tuple(-1.0 if negated(number) in seen else 1.0 for number in (1, 2))
        alike = [meant for meant in alike if meant.columns == (0, 1) and meant.signs == signs] or alike
    words = " or ".join(meant.words for meant in alike)
    fact = (
        f"the joints seem to lead at reversals, which play cannot cause: the acw and cw circles fit only with {words} "
        f"(error {1e3 * as_meant:.1f} instead of {1e3 * as_labelled:.1f} µm)"
    )
    exchanged = alike[0].columns == (1, 0)
    names = tuple(run.run.manifest.name for run in runs)
    misfit = Misfit(as_labelled, as_meant, gain)
    remedy = _EXCHANGE if exchanged else _REMEDY
    strength: Strength = "decisive" if labelled >= _FITS_WELL * least else "likely"
    yield Finding(ORDER if exchanged else SIGN, strength, _COLUMNS, words, fact, remedy, misfit, names)


@dataclass(frozen=True)
class _Meant:
    """Possible content of the columns of two gauges: the gauges meant (2,), and their signs (2,)."""

    words: str
    columns: tuple[int, int]
    signs: tuple[float, float]


_MEANT = (
    _Meant("both as labelled", (0, 1), (1.0, 1.0)),
    _Meant("both gauges counting in the opposite direction", (0, 1), (-1.0, -1.0)),
    _Meant("g1 counting in the opposite direction", (0, 1), (-1.0, 1.0)),
    _Meant("g2 counting in the opposite direction", (0, 1), (1.0, -1.0)),
    _Meant("g1 and g2 exchanged", (1, 0), (1.0, 1.0)),
    _Meant("g1 and g2 exchanged and counting in the opposite direction", (1, 0), (-1.0, -1.0)),
)


def _as(way: _Way, meant: _Meant) -> _Way:
    """Return a direction with the columns of the gauges in a possible meaning."""
    signs, columns = np.array(meant.signs), list(meant.columns)
    return replace(way, g_mm=way.g_mm[:, columns] * signs, stuck=way.stuck[:, columns] * signs)


def _pairs(runs: Sequence[Measured]) -> Iterator[tuple[Rig, TestName, dict[str, list[_Way]]]]:
    """Yield the circles of each test and placement that were driven both ways, with their rig, on the grid. Runs
    with no lap are reported by the analysis."""
    pairs: dict[tuple[object, ...], tuple[Rig, TestName, dict[str, list[_Way]]]] = {}
    for run in runs:
        table = run.table
        if not isinstance(table, CircleTable) or table.g_mm.shape[1] != 2:
            continue
        with suppress(FileError):
            laps = laps_of(table, run.rig, str(run.path))
            flank = np.stack([(play(joint, _PLAY_RAD) - joint) / _PLAY_RAD for joint in table.q.T], axis=1)
            stuck = [(play(gauge, 2 * _RESOLVED_MM) - gauge) / (2 * _RESOLVED_MM) for gauge in table.g_mm.T]
            moving = np.concatenate([np.gradient(table.q, table.t_s, axis=0), flank, np.stack(stuck, axis=1)], axis=1)
            since = (laps.t_s - laps.t_s[0]) / max(float(np.ptp(laps.t_s)), 1e-9)
            rows = np.searchsorted(table.t_s, laps.t_s)
            columns = [laps.g_mm, np.cos(laps.q), np.sin(laps.q), moving[rows], since[:, None]]
            grid = gridded(laps.phi, np.concatenate(columns, axis=1))
            way = _Way(grid[:, :2], grid[:, 2:14], grid[:, 14:20], grid[:, 20:26], grid[:, 26:28], grid[:, 28])
            key = (table.test, run.run.manifest.placement, repr(run.rig.tests.circle))
            ways = pairs.setdefault(key, (run.rig, table.test, {}))[2]
            ways.setdefault(table.direction, []).append(way)
    yield from (pair for pair in pairs.values() if len(pair[2]) == 2)


def _mean(ways: Sequence[_Way]) -> _Way:
    return _Way(*(np.mean([getattr(way, name) for way in ways], axis=0) for name in vars(ways[0])))


def _left_of_plays(slopes: Array, acw: _Way, cw: _Way) -> float:
    """Return the energy in mm² of the difference of both directions remaining after lagging backlash, given the
    slopes of the gauges by each joint (GRID, 2, 6) mm/rad. Dependence on the angles is the same both ways; drift,
    late times and a sticking gauge are removed."""
    from scipy.optimize import nnls  # noqa: PLC0415 - slow to import, needed here only

    plays = (slopes * (acw.flank - cw.flank)[:, None, :]).reshape(-1, 6)
    late = (slopes * (acw.speed - cw.speed)[:, None, :]).reshape(-1, 6)
    phi = np.arange(GRID) * 2 * np.pi / GRID
    slow = np.stack([np.ones(GRID), np.cos(phi), np.sin(phi), acw.since, cw.since], axis=1)
    each = np.concatenate([np.kron(slow, unit[:, None]) for unit in np.eye(2)], axis=1)
    stuck = np.zeros((GRID, 2, 2))
    stuck[:, [0, 1], [0, 1]] = acw.stuck - cw.stuck
    design = np.concatenate([each, late, stuck.reshape(-1, 2)], axis=1)
    length = np.linalg.norm(design, axis=0)
    taken, sizes, _ = np.linalg.svd(design / np.where(length > 0, length, 1.0), full_matrices=False)
    basis = taken[:, sizes > 1e-9 * sizes[0]]
    rest_of_readings, plays = (values - basis @ (basis.T @ values) for values in ((acw.g_mm - cw.g_mm).ravel(), plays))
    return float(nnls(plays, rest_of_readings)[1]) ** 2


def _slopes(rig: Rig, test: TestName, acw: _Way, cw: _Way) -> Array:
    """Return the slopes (GRID, 2, 6) in mm/rad of both gauges by each joint of the nominal arm, at the positions of
    both directions."""
    circle = circle_of(rig)
    # A robot that drives on is turns apart between the directions, and from lap to lap: only the posture counts.
    cosine, sine = np.split(acw.heading + cw.heading, 2, axis=1)
    q = np.arctan2(sine, cosine)
    arm, centre = arm_of(rig.robot), frame_of(circle).centre
    offsets = np.array([gauge.offset_mm for _, gauge in rig.gauges])[:2]

    def gauge_readings(angles: Array) -> Array:
        return link_readings(forward(arm, angles), centre, offsets, test, circle.radius_mm)  # type: ignore[arg-type]

    steps = _STEP * np.eye(6)
    return np.stack([(gauge_readings(q + step) - gauge_readings(q - step)) / (2 * _STEP) for step in steps], axis=2)
