"""Detection of inverted or exchanged gauges.

If both gauges are inverted, every size and sign is reversed, and most runs look plausible. Two facts reveal sign and
order: a joint with backlash lags behind its drive and never leads, and the errors in the rig file are known. Without
either, the data do not reveal the sign.

Repeated circles reveal cables or columns that were swapped between them. An exchange preserves the mean of the gauges
and reverses the sign of their difference; an inversion reverses both. A moved ball also changes both, but only in the
first order of the circle, so the signs are compared by the higher orders.

Evidence within a single yaw run causes a doubt, never a refusal. The distance (mean of the gauges) and the angle
between the gauges show the same eccentricity e of the ball. If the gauges are exchanged, the angle shows -e, so the two
differ by 2 |e|. An error of the arm that rotates the tool in the first order of the circle also changes them, and large
faults exceed the eccentricity of a well-mounted ball. But such an error also has other orders: an exchange is likely if
the difference exceeds the expectation from the rest of the readings.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from analysis.procedures.shared.test_kind import (
    Finding,
    Misfit,
    Strength,
    findings_against,
    kind_of,
    nominal_setup,
    path_of,
    read,
)
from analysis.robot.geometry.circle import frame_of, link_angle, link_readings
from analysis.robot.geometry.driven_programs import circle_of
from analysis.robot.kinematics.arm import Array, arm_of, drive_angles, forward
from analysis.robot.predict import Model, model_of, moved
from analysis.runs.laps import is_on_circle, laps_of
from analysis.runs.loading import Measured
from analysis.runs.noise.readings import rms
from analysis.runs.tables import CircleTable, Table, format_of
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.scene import play
from rigs.schema.vocabulary import TestName

T = TypeVar("T")
ORDER, SIGN = "gauge order", "gauge sign"
EXCHANGED = "g1 and g2 may be exchanged"
_ORDER_ROWS = 5000
"""Number of rows sufficient for the first order of a run."""
_WHOLE = 0.9
"""Minimum share of a lap for determining the first order."""
_CLOSER = 0.5
"""Largest ratio of the distance between the two eccentricities with exchanged gauges to the distance as labelled."""
_BEYOND = 2.0
"""Minimum distance between the two eccentricities as a multiple of the rms of all other orders. This factor and
_CLOSER are chosen: docs/evidence/conventions.md counts wrong doubts and missed exchanges.
"""
_SEEN_MM, _NEGATED = 0.2, 0.25
"""Relative difference up to which the two eccentricities agree if one gauge is inverted, and their smallest size.

Chosen: an error of the arm has the same size and direction only by chance.
"""


def order_findings(table: CircleTable, rig: Rig) -> Iterator[Finding]:
    """A finding if the two eccentricities of a yaw run agree only with g1 and g2 exchanged, or one inverted."""
    circle = rig.tests.circle
    if circle is None or rig.gauges.g2 is None:
        return
    table = table.thinned(_ORDER_ROWS)
    frame, places = frame_of(circle), forward(arm_of(rig.robot), table.q)[:, :3, 3]
    on = is_on_circle(places, frame) & np.isfinite(table.g_mm).all(axis=1)
    if table.g_mm.shape[1] < 2 or not on.any():
        return
    phi, g_mm = frame.angle(places[on]), table.g_mm[on, :2]
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
            f"g1 and g2 may be exchanged, which reverses every angle: the ball is ({u:z.2f}, {v:z.2f}) mm off centre "
            f"by their mean, ({angle_u:z.2f}, {angle_v:z.2f}) mm by their difference"
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
    """Eccentricity of the ball, (2,) mm along phi = 0° and 90°, from the mean of the gauges and from the angle between
    them.

    rest_mm: rms of the remaining readings.
    """

    by_distance: Array
    by_angle: Array
    rest_mm: float

    @property
    def apart_mm(self) -> float:
        return float(np.linalg.norm(self.by_angle - self.by_distance))

    @property
    def size_mm(self) -> float:
        return float(np.linalg.norm(self.by_angle + self.by_distance)) / 2

    @classmethod
    def of(cls, phi: Array, g_mm: Array, radius_mm: float, baseline_mm: float) -> _Eccentricities:
        by_gauges = link_angle(g_mm[:, 0], g_mm[:, 1], baseline_mm)
        seen = np.stack([g_mm.mean(axis=1), radius_mm * by_gauges], axis=1)
        waves = np.stack([np.ones_like(phi), np.cos(phi), np.sin(phi)], axis=1)
        fit = np.linalg.lstsq(waves, seen, rcond=None)[0]
        rms_mm = float(np.sqrt(np.mean((seen - waves @ fit) ** 2) * 2))
        return cls(-fit[1:, 0], np.array([-fit[2, 1], fit[1, 1]]), rms_mm)


def negated(number: int) -> str:
    return f"g{number} may count the other way"


GRID = 256
"""Circle angles to which laps are interpolated for comparison."""
_LEAST_MM = 0.05
"""Smallest examined difference from repeated runs. Joints of real cells repeat to 0.005°, which moves gauges 50 mm
apart by 0.01 mm; the limit is five times larger.
"""
_CLEAR = 4.0
"""Factor by which the difference must fit better with reversed sign, and the mean better unchanged. Chosen: far
above the factor of 1 caused by noise.
"""


@dataclass(frozen=True)
class Lap:
    """A circle run on the grid: mean and difference of the gauges (GRID,) mm, each with the mean subtracted."""

    run: Measured
    mean: Array
    apart: Array

    @property
    def place(self) -> tuple[object, ...]:
        """Properties shared by runs with the same ball."""
        manifest = self.run.run.manifest
        return (manifest.test, manifest.placement, self.run.rig.tests.circle, self.run.rig.robot)


def laps_on_grid(runs: Iterable[Measured]) -> list[Lap]:
    """Circle runs with two gauges on the grid. Runs without a lap are reported elsewhere."""
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
    """Mean (GRID, k) of values (n, k) around each angle of the grid; gaps are interpolated."""
    place = np.round(phi * GRID / (2 * np.pi)).astype(int) % GRID
    count = np.bincount(place, minlength=GRID)
    filled = np.flatnonzero(count)
    means = [np.bincount(place, column, GRID)[filled] / count[filled] for column in values.T]
    return np.stack([np.interp(np.arange(GRID), filled, mean, period=GRID) for mean in means], axis=1)


def repeat_findings(runs: Sequence[Measured]) -> Iterator[Finding]:
    """Findings about runs that contradict their repeats.

    Of two equal halves, the one that contradicts the circles of the opposite direction is reported.
    """
    laps = laps_on_grid(runs) if len(runs) > 1 else []
    for group in _grouped(laps, lambda lap: (lap.run.run.manifest.direction, lap.place)):
        direction = group[0].run.run.manifest.direction
        reverse = [lap for lap in laps if lap.place == group[0].place and lap.run.run.manifest.direction != direction]
        yield from _contradicting(group, reverse)


def _grouped(items: Iterable[T], key: Callable[[T], object]) -> list[list[T]]:
    groups: list[tuple[object, list[T]]] = []
    for item in items:
        key_of_item = key(item)
        group = next((group for key_of_group, group in groups if key_of_group == key_of_item), None)
        if group is None:
            groups.append((key_of_item, [item]))
        else:
            group.append(item)
    return [group for _, group in groups]


def _contradicting(repeats: Sequence[Lap], reverse: Sequence[Lap]) -> Iterator[Finding]:
    """A finding for repeats in which the difference of the gauges has the opposite sign to most others."""
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
        spectra[:, 1] = 0.0  # the first order may be caused by a moved ball
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
"""Correlation length of the residual curves of two laps, in steps of 1.4°. Readings within it count as one."""
_DECISIVE = 12.0
"""Difference of the log-likelihoods from which the sign of a backlash is certain: odds of 160 000 to 1, because
drift and waves are not white noise.
"""
_FITS, _FITS_WELL = 4.0, 6.0
"""Minimum ratios of the residual energies with backlash. Below the first, both labellings fit equally well. Below the
second, the better one leaves two fifths of the readings unexplained, so the finding is only a doubt.
"""
_RESOLVED_MM = 0.003
"""Lower limit of the rms residual with backlash as labelled: the resolution of gauges of 1 µm."""
_PLAY_RAD = float(np.radians(0.01))
"""Joint motion that counts as a reversal: less than real backlash, and more than encoder noise."""
_KNOWN = 4.0
"""Factor by which inverted readings must fit the effects of the rig file better. An arm that has changed does not
change to the opposite sign.
"""
_KNOWN_MM = 0.02
"""Residual below which the readings, as labelled, agree with the rig file."""
_ROWS = 1500
_STEP = 1e-4


def sign_findings(runs: Sequence[Measured]) -> Iterator[Finding]:
    gauged = [run for run in runs if format_of(run.table.test).gauges]
    for group in _grouped(gauged, lambda run: (run.rig.gauges, run.rig.robot)):
        by_effects = [finding for run in group for finding in _known_effects(run)]
        yield from by_effects
        if not by_effects:
            yield from _leading_play(group)


def _known_effects(run: Measured) -> Iterator[Finding]:
    if not run.rig.effects and not run.rig.calibrated:
        return
    model, table = model_of(run.rig), run.table
    if not model.effects or not format_of(table.test).gauges or kind_of(table.test).cannot_tell(table, run.rig):
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
    """Rms residual in mm of readings multiplied by a sign, with fitted ball and zeros."""
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
    """Laps of one direction on the grid.

    readings (GRID, 2) mm; angles as unit vectors, cosine and sine (GRID, 12), for a mean modulo a turn; speeds (GRID,
    6) rad/s; flank of each drive (GRID, 6) and each gauge (GRID, 2), -1 to 1; time (GRID,) since the start, 0 to 1.
    """

    g_mm: Array
    heading: Array
    speed: Array
    flank: Array
    stuck: Array
    since: Array


def _leading_play(runs: Sequence[Measured]) -> Iterator[Finding]:
    """Findings about circles in both directions in which joints lead at reversals as labelled, and lag with an
    alternative meaning. All runs of these gauges are then doubtful.
    """
    if {run.run.manifest.direction for run in runs} < {"acw", "cw"}:
        return
    energies, values = np.zeros(len(_GAUGE_CONTENTS)), 0.0
    for rig, test, both in _pairs(runs):
        acw, cw = (_mean(both[way]) for way in ("acw", "cw"))
        slopes = _slopes(rig, test, acw, cw)
        energies += [_left_of_plays(slopes, _as(acw, meant), _as(cw, meant)) for meant in _GAUGE_CONTENTS]
        values += 2 * GRID / _ALIKE
    if not values or not energies.all():
        return
    best = int(np.argmin(energies))
    labelled, least = float(energies[0]), float(energies[best])
    gain = values / 2 * float(np.log(labelled / least))
    as_labelled, as_meant = (float(np.sqrt(energy / (values * _ALIKE))) for energy in (labelled, least))
    if gain < _DECISIVE or labelled < _FITS * least or as_labelled < _RESOLVED_MM:
        return
    # Backlash does not distinguish these meanings; the eccentricities from mean and difference of the gauges decide.
    alike = [meant for meant, energy in zip(_GAUGE_CONTENTS, energies, strict=True) if energy < _FITS * least]
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
class _GaugeContent:
    """Alternative content of the two gauge columns: the gauge in each, and its sign."""

    words: str
    columns: tuple[int, int]
    signs: tuple[float, float]


_GAUGE_CONTENTS = (
    _GaugeContent("both as labelled", (0, 1), (1.0, 1.0)),
    _GaugeContent("both gauges counting in the opposite direction", (0, 1), (-1.0, -1.0)),
    _GaugeContent("g1 counting in the opposite direction", (0, 1), (-1.0, 1.0)),
    _GaugeContent("g2 counting in the opposite direction", (0, 1), (1.0, -1.0)),
    _GaugeContent("g1 and g2 exchanged", (1, 0), (1.0, 1.0)),
    _GaugeContent("g1 and g2 exchanged and counting in the opposite direction", (1, 0), (-1.0, -1.0)),
)


def _as(way: _Way, meant: _GaugeContent) -> _Way:
    signs, columns = np.array(meant.signs), list(meant.columns)
    return replace(way, g_mm=way.g_mm[:, columns] * signs, stuck=way.stuck[:, columns] * signs)


def _pairs(runs: Sequence[Measured]) -> Iterator[tuple[Rig, TestName, dict[str, list[_Way]]]]:
    """Circles of each test and placement driven in both directions, with their rig, on the grid."""
    pairs: dict[tuple[object, ...], tuple[Rig, TestName, dict[str, list[_Way]]]] = {}
    for run in runs:
        table = run.table
        if not isinstance(table, CircleTable) or table.g_mm.shape[1] != 2:
            continue
        with suppress(FileError):
            laps = laps_of(table, run.rig, str(run.path))
            drives = drive_angles(arm_of(run.rig.robot), table.q)
            flank = np.stack([(play(drive, _PLAY_RAD) - drive) / _PLAY_RAD for drive in drives.T], axis=1)
            stuck = [(play(gauge, 2 * _RESOLVED_MM) - gauge) / (2 * _RESOLVED_MM) for gauge in table.g_mm.T]
            moving = np.concatenate([np.gradient(drives, table.t_s, axis=0), flank, np.stack(stuck, axis=1)], axis=1)
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
    """Energy in mm² of the difference between the directions that backlash does not explain.

    slopes (GRID, 2, 6) mm/rad: change of both gauges by each joint. Errors that depend on the joint angles cancel in
    the difference. Drift, late times and a sticking gauge are removed.
    """
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
    """Derivatives (GRID, 2, 6) in mm/rad of both gauges by each drive of the nominal arm, for both
    directions.
    """
    circle = circle_of(rig)
    # Joints of a robot that continues instead of returning differ by full turns between directions and laps: only the
    # posture counts.
    cosine, sine = np.split(acw.heading + cw.heading, 2, axis=1)
    nominal, centre = arm_of(rig.robot), frame_of(circle).centre
    arm, q = nominal.by_drives, drive_angles(nominal, np.arctan2(sine, cosine))
    offsets = np.array([gauge.offset_mm for _, gauge in rig.gauges])[:2]

    def gauge_readings(angles: Array) -> Array:
        return link_readings(forward(arm, angles), centre, offsets, test, circle.radius_mm)  # type: ignore[arg-type]

    steps = _STEP * np.eye(6)
    return np.stack([(gauge_readings(q + step) - gauge_readings(q - step)) / (2 * _STEP) for step in steps], axis=2)
