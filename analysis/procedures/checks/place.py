"""Checks of position, speed and instrument of a table against the rig file.

- With the nominal arm, and independently of the gauges, the robot must be on the path of the test. The arm has errors
  of some
mm, and a cell is rarely within 20 mm of the place in the rig file.
- Several readings of one standstill, given as separate visits, are averaged, and the user gets a message.
- Positions computed by the controller from the joints contain no information about the arm. Two facts reveal them,
independently of the name of a column or topic. No reflector is in the middle of the flange face while the frame of the
instrument is the base of the arm. And neither instruments nor robots repeat to the last digit, so positions that fitted
constants explain even more closely were computed.
- Target or instrument may have moved during the run. With all constants fitted, the residual is noise and a small
  unmodelled
error. A far smaller residual with a separate placement for the rows after a certain row, or for every other row,
reveals
the movement.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from analysis.procedures.checks.meanings import FEWEST, RIGHT_MM
from analysis.procedures.shared.finding import Finding, Misfit
from analysis.procedures.shared.test_kind import kind_of
from analysis.robot.geometry.circle import frame_of
from analysis.robot.geometry.pose_setup import (
    DETERMINED,
    FittedArm,
    fit_arm,
    fit_setup,
    position_error,
)
from analysis.robot.kinematics.arm import Arm, Array, Mask, arm_of, forward, without_setup
from analysis.runs.loading import Measured
from analysis.runs.stands import rows_per_standstill
from analysis.runs.table_format import table_from
from analysis.runs.tables import CircleTable, PoseTable, Table
from rigs.rig import Rig
from rigs.text import counted

_FEWEST_ROWS, _SPLITS = 4, 24
"""Minimum number of rows of a part (the nine unknowns of a placement leave three readings), and number of possible
splits that are tried first.
"""
SPARE, FITTED = 30, 300
"""Minimum number of redundant readings for a fit of all constants, and number of poses that is sufficient."""
_SHARE, _SHARE_OF_FEW = 0.6, 0.3
"""Largest ratio of the residuals with and without a second placement, and the ratio for few rows or few redundant
readings (_MANY_ROWS, _MANY_SPARE). For a UR10 and a UR5 measured over hours, the best of all splits leaves at
least 0.86 for 30 to 1495 poses in order, and at least 0.51 for 272 sets of 20 to 40 poses.
"""
_MANY_ROWS, _MANY_SPARE = 8, 120
_LEAST_MM = 0.05
"""Residual below which no movement is assumed: less than the noise of trackers."""


def two_placings(table: PoseTable, bare: Arm) -> str:
    """A description of the rows measured after target or instrument had moved; empty if there are none, or
    too few poses.
    """
    count = len(table.q)
    chosen = np.unique(np.linspace(0, count - 1, min(FITTED, count)).astype(int))
    if count < 2 * _FEWEST_ROWS:
        return ""
    q, xyz_mm, rows = table.q[chosen], table.xyz_mm[chosen], table.rows[chosen]
    fitted = fit_arm(bare, q, xyz_mm)
    if fitted.spare < SPARE or fitted.rms_mm < _LEAST_MM:
        return ""
    T = forward(fitted.arm, q)
    best, words, many = np.inf, "", _MANY_ROWS if fitted.spare >= _MANY_SPARE else count
    for part, called in _parts(rows, lambda part: _left_mm(fitted, T, part)):
        after, few = _left_mm(fitted, T, part), min(part.sum(), (~part).sum())
        if after < min(best, (_SHARE if few >= many else _SHARE_OF_FEW) * fitted.rms_mm):
            best, words = after, called
    if not words:
        return ""
    return (
        f"{words} were measured with target or instrument at a different place than the others: with a separate "
        f"placement the error is {best:.2g} instead of {fitted.rms_mm:.2g} mm"
    )


def _parts(rows: Array, left_mm: Callable[[Mask], float]) -> Iterator[tuple[Mask, str]]:
    """Possible sets of moved rows with their descriptions: the rows after the split with the smallest residual
    (first a few splits, then their neighbours), and every other row if there are enough.
    """
    place, last = np.arange(len(rows)), len(rows) - _FEWEST_ROWS
    tried = np.unique(np.linspace(_FEWEST_ROWS, last, _SPLITS).astype(int)).tolist()
    near, step = min(tried, key=lambda first: left_mm(place >= first)), last // _SPLITS
    first = min(range(max(_FEWEST_ROWS, near - step), min(last, near + step) + 1), key=lambda k: left_mm(place >= k))
    yield place >= first, f"rows from about {rows[first]} on"
    second = rows % 2 == 0
    if min(second.sum(), (~second).sum()) >= _FEWEST_ROWS:
        yield second, "every other row"


def _left_mm(fitted: FittedArm, T: Array, part: Mask) -> float:
    """Rms residual in mm, corrected for the number of unknowns, of a fit of the constants.

    The rows `part` of the tool poses T (n, 4, 4) have a separate shift, rotation and target offset.
    """
    p = (T[:, :3, 3] - T[:, :3, 3].mean(axis=0)) / 1000.0
    (x, y, z), zero = p.T, np.zeros(len(p))
    turned = np.stack([zero, z, -y, -z, zero, x, y, -x, zero], axis=1).reshape(-1, 3, 3)
    shifted = np.tile(np.eye(3), (len(p), 1, 1))
    placing = (np.concatenate([shifted, turned, T[:, :3, :3]], axis=2) * part[:, None, None]).reshape(-1, 9)
    design = np.concatenate([fitted.design, placing], axis=1)
    left_mm = fitted.left_mm - design @ np.linalg.lstsq(design, fitted.left_mm, rcond=DETERMINED)[0]
    return replace(fitted, left_mm=left_mm, spare=fitted.spare - 9).rms_mm


STAMPS, PLACE = "stamps", "place"
_NEAR_MM = 20.0
_ROWS = 5000
"""Number of rows sufficient to estimate the speed along a circle."""
_UNITS_S = {"ms": 1e-3, "µs": 1e-6, "ns": 1e-9}
_OFF = 3.2
"""Factor by which a speed must differ to prove a wrong unit; no circle is driven at such a speed."""


def stamp_findings(table: CircleTable, rig: Rig) -> Iterator[Finding]:
    """A finding if the mean speed along the circle is wrong by a unit. Reading refuses decreasing timestamps."""
    circle = rig.tests.circle
    if circle is None:
        return
    rows = slice(None, None, max(1, len(table.q) // _ROWS))
    phi = frame_of(circle).angle(forward(arm_of(rig.robot), table.q[rows])[:, :3, 3])
    seconds = float(np.ptp(table.t_s))
    if seconds == 0:
        return
    driven_rad = float(np.abs(np.diff(np.unwrap(phi))).sum())  # laps and the return paths between them
    share = driven_rad * circle.radius_mm / seconds / circle.speed_mm_s
    fact = f"the circle was driven at {share:.2g} times the speed_mm_s of the rig file"
    for unit, unit_s in _UNITS_S.items():
        if 1 / _OFF < share / unit_s < _OFF:
            yield Finding(STAMPS, "likely", ("t_s",), unit, fact, f"t_s may be in {unit}: check it")
        elif 1 / _OFF < share * unit_s < _OFF:
            yield Finding(STAMPS, "likely", ("t_s",), "another unit", fact, "check the units of t_s and speed_mm_s")


def place_findings(table: Table, rig: Rig) -> Iterator[Finding]:
    places = kind_of(table.test).targets(table, rig)
    if places is None:
        return
    away = np.linalg.norm(forward(arm_of(rig.robot), table.q)[:, :3, 3] - places, axis=1)
    far = away > _NEAR_MM
    if far.any():
        row = int(np.argmax(far))
        target = table.numbers[row]
        fact = (
            f"according to the nominal arm, the tool was {away[row]:.0f} mm from target {target} in row {row + 1}, and "
            f"further away than {_NEAR_MM:g} mm in {far.sum()} of {len(far)} rows"
        )
        yield Finding(
            PLACE, "likely", ("target",), "another target", fact, "check the target numbers, the angles and the joints"
        )


STANDS = "stands"


def stand_findings(run: Measured) -> Iterator[Finding]:
    """A finding about the first reading whose target is far from the tool position of the nominal arm."""
    manifest, table = run.run.manifest, run.run.table
    if table is None or run.table.swept:
        return
    counts = rows_per_standstill(table_from(table, manifest.test, manifest.direction, str(run.path)))
    several = counts[counts > 1]
    if not len(several):
        return
    stands = counted(len(several), "stand")
    fact = (
        f"{several.sum()} rows are repeated readings, up to {several.max()} each, of {stands} of the robot: the mean "
        "of each stand is used"
    )
    remedy = "if the robot moved in between, write the rows in the order in which they were measured"
    yield Finding(STANDS, "likely", (), "readings of one standstill", fact, remedy)


SOURCE = "source"
OF_CONTROLLER = "rig arms NAME --poses TABLE -o arm.yaml reads the calibration of the controller from them"
"""Recommended use of positions computed by a controller."""
NO_INSTRUMENT_MM = 0.008
"""Smallest residual of measured positions. Rounding to 0.01 mm leaves 0.005 mm, the best trackers state at least
0.010 mm (Leica AT960: 15 µm + 6 µm/m), and arms repeat to 0.01 mm.
"""
_BASE_MM, _BASE_RAD, _FLANGE_MM = 3.0, float(np.radians(0.3)), 2.0
"""Uncertainty of frame and target with the nominal constants of an arm, as found in calibrations of sound arms. The
smallest reflectors are balls of 12.7 mm on a nest.
"""
_POSES = 150


@dataclass(frozen=True)
class PlaceSource:
    """Evidence on places that fit an arm: were they measured, or computed from the joints by the controller?

    left_mm, fitted: rms residual with nominal constants, and the arm with fitted ones. in_base: True if the places are
    given in the base of the arm. proof: why they were computed, empty if they may be measured.
    """

    left_mm: float
    fitted: FittedArm
    in_base: bool
    proof: str


def source_of(bare: Arm, q: Array, xyz_mm: Array) -> PlaceSource | None:
    """Compare places xyz_mm (n, 3) with an arm without base and tool at joints q (n, axes) rad; None if they do not
    fit it.
    """
    T = forward(bare, q)
    setup = fit_setup(T, xyz_mm)
    left_mm = float(np.sqrt((position_error(T, xyz_mm, setup) ** 2).sum(axis=1).mean()))
    if left_mm > RIGHT_MM:
        return None
    target_mm = float(np.linalg.norm(setup.T_flange_tool[:3, 3]))
    fitted = fit_arm(bare, q, xyz_mm)
    # The base of the arm, or the base rotated by half a turn about z, as base_link of ROS drivers.
    base = setup.T_world_base
    traces = [np.trace(base[:3, :3] @ np.diag([sign, sign, 1.0])) for sign in (1.0, -1.0)]
    turned_rad = float(np.arccos(np.clip((max(traces) - 1) / 2, -1.0, 1.0)))
    in_base = turned_rad < _BASE_RAD and float(np.linalg.norm(base[:3, 3])) < _BASE_MM
    proof = ""
    if fitted.spare >= SPARE and fitted.rms_mm < NO_INSTRUMENT_MM:
        proof = (
            f"the arm's constants explain them to {1e3 * fitted.rms_mm:.2g} µm, closer than any instrument can measure"
        )
    elif in_base and target_mm < _FLANGE_MM:
        proof = f"they are given in the base of the arm, for a point {target_mm:.1f} mm from the centre of the flange"
    return PlaceSource(left_mm, fitted, in_base, proof)


def source_findings(table: PoseTable, rig: Rig) -> Iterator[Finding]:
    if table.rail:
        return
    measured = np.flatnonzero((table.xyz_mm != 0).any(axis=1))
    if len(measured) < FEWEST:
        return
    chosen = measured[np.unique(np.linspace(0, len(measured) - 1, min(_POSES, len(measured))).astype(int))]
    source = source_of(without_setup(arm_of(rig.robot)), table.q[chosen], table.xyz_mm[chosen])
    if source is None or not source.proof:
        return
    left_mm, fitted = source.left_mm, source.fitted
    fact = f"these places were not measured but computed from the joints by the controller: {source.proof}"
    remedy = f"give places measured by an instrument; {OF_CONTROLLER}"
    misfit = Misfit(left_mm, fitted.rms_mm, float(fitted.left_mm.size * np.log(left_mm / max(fitted.rms_mm, 1e-9))))
    columns = ("x_mm", "y_mm", "z_mm")
    yield Finding(SOURCE, "impossible", columns, "the controller's own places", fact, remedy, misfit)
