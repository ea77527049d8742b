"""Whether a table was measured where and as fast as its rig file says.

By the nominal arm: it errs by some mm, and a cell is seldom where its file says to much better than 20 mm.

Several readings of one stand that were given as so many visits: their means are used, and it is said.

Whether an instrument measured the places of poses, or the controller computed them: from its joints by its own
constants. Such places say nothing of where the arm was.

Two things prove it, whatever a column or a topic is called. No reflector sits in the middle of the flange's face while
the instrument's frame is the arm's base. And no instrument and no robot repeat to the last digit: places that the arm's
constants, all free, explain closer than that were computed from the joints.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from analysis.conventions.finding import Finding, Misfit
from analysis.conventions.joints import FEWEST, RIGHT_MM
from analysis.conventions.two_placings import SPARE
from analysis.geometry.circle import frame_of
from analysis.geometry.pose_setup import fit_arm, fit_setup, position_error
from analysis.kinematics.arm import arm_of, forward, without_setup
from analysis.traces.csv_tables import table_from
from analysis.traces.loading import Measured
from analysis.traces.stands import rows_a_stand
from analysis.traces.tables import CircleTable, PoseTable, Table
from rigs.rig import Rig

STAMPS, PLACE = "stamps", "place"
_NEAR_MM = 20.0
_ROWS = 5000
"""So many rows are enough to see how fast a circle was driven."""
_UNITS_S = {"ms": 1e-3, "µs": 1e-6, "ns": 1e-9}
_OFF = 3.2
"""A speed within so many times of a unit's is taken as off by that unit: a circle is never driven at such a speed."""


def stamp_findings(table: CircleTable, rig: Rig) -> Iterator[Finding]:
    """Whether the mean speed along the circle is off by a unit. Stamps that go back are refused where they are read."""
    circle = rig.tests.circle
    if circle is None:
        return
    rows = slice(None, None, max(1, len(table.q) // _ROWS))
    phi = frame_of(circle).angle(forward(arm_of(rig.robot), table.q[rows])[:, :3, 3])
    seconds = float(np.ptp(table.t_s))
    if seconds == 0:
        return
    driven_rad = float(np.abs(np.diff(np.unwrap(phi))).sum())  # laps and the ways back between them
    share = driven_rad * circle.radius_mm / seconds / circle.speed_mm_s
    fact = f"the circle was driven at {share:.2g} times the speed_mm_s of the rig file"
    for unit, unit_s in _UNITS_S.items():
        if 1 / _OFF < share / unit_s < _OFF:
            yield Finding(STAMPS, "likely", ("t_s",), unit, fact, f"t_s may be in {unit}: check it")
        elif 1 / _OFF < share * unit_s < _OFF:
            yield Finding(STAMPS, "likely", ("t_s",), "another unit", fact, "check the units of t_s and speed_mm_s")


def place_findings(table: Table, rig: Rig) -> Iterator[Finding]:
    """The first reading that the nominal arm takes elsewhere than to its target."""
    places = table.kind.targets(table, rig)
    if places is None:
        return
    away = np.linalg.norm(forward(arm_of(rig.robot), table.q)[:, :3, 3] - places, axis=1)
    far = away > _NEAR_MM
    if far.any():
        row = int(np.argmax(far))
        target = table.kind.numbers_of(table)[row]
        fact = (
            f"by the nominal arm the tool was {away[row]:.0f} mm from target {target} in row {row + 1}, and "
            f"further than {_NEAR_MM:g} mm in {far.sum()} of {len(far)} rows"
        )
        yield Finding(PLACE, "likely", ("target",), "another target", fact, "check target, angles, joints")


STANDS = "stands"


def stand_findings(run: Measured) -> Iterator[Finding]:
    """How many rows of an imported run were several readings of one stand."""
    manifest, table = run.run.manifest, run.run.table
    if table is None or run.table.kind.swept:
        return
    counts = rows_a_stand(table_from(table, manifest.test, manifest.direction, str(run.path)))
    several = counts[counts > 1]
    if not len(several):
        return
    stands = "1 stand" if len(several) == 1 else f"{len(several)} stands"
    fact = (
        f"{several.sum()} rows are {stands} of the robot, read up to {several.max()} times without a move: their "
        "means are used, one for each"
    )
    remedy = "if the robot moved in between, give the rows of a pose after those of another"
    yield Finding(STANDS, "likely", (), "readings of one stand", fact, remedy)


SOURCE = "source"
OF_CONTROLLER = "rig arms NAME --poses TABLE -o arm.yaml reads its calibration out of them"
"""What such places are good for."""
NO_INSTRUMENT_MM = 0.008
"""Digits of 0.01 mm leave 0.005 mm; the best trackers state 0.010 mm and more (Leica AT960: 15 µm + 6 µm/m), and arms
repeat to 0.01 mm."""
_BASE_MM, _BASE_RAD, _FLANGE_MM = 3.0, float(np.radians(0.3)), 2.0
"""How well frame and target are known by an arm's nominal constants: the calibrations of sound arms move them by so
much. The smallest reflectors are balls of 12.7 mm on a nest."""
_POSES = 150


def source_findings(table: PoseTable, rig: Rig) -> Iterator[Finding]:
    """Whether the places of poses were computed, not measured."""
    if table.rail:
        return
    measured = np.flatnonzero((table.xyz_mm != 0).any(axis=1))
    if len(measured) < FEWEST:
        return
    chosen = measured[np.unique(np.linspace(0, len(measured) - 1, min(_POSES, len(measured))).astype(int))]
    bare, q, xyz_mm = without_setup(arm_of(rig.robot)), table.q[chosen], table.xyz_mm[chosen]
    T = forward(bare, q)
    setup = fit_setup(T, xyz_mm)
    left_mm = float(np.sqrt((position_error(T, xyz_mm, setup) ** 2).sum(axis=1).mean()))
    if left_mm > RIGHT_MM:
        return
    target_mm = float(np.linalg.norm(setup.T_flange_tool[:3, 3]))
    fitted = fit_arm(bare, q, xyz_mm)
    computed = fitted.spare >= SPARE and fitted.rms_mm < NO_INSTRUMENT_MM
    # The arm's base, or that turned half round about z, as base_link of ROS drivers is.
    base = setup.T_world_base
    traces = [np.trace(base[:3, :3] @ np.diag([sign, sign, 1.0])) for sign in (1.0, -1.0)]
    turned_rad = float(np.arccos(np.clip((max(traces) - 1) / 2, -1.0, 1.0)))
    is_base = turned_rad < _BASE_RAD and float(np.linalg.norm(base[:3, 3])) < _BASE_MM
    in_flange = is_base and target_mm < _FLANGE_MM
    if not computed and not in_flange:
        return
    proof = (
        f"the arm's constants explain them to {1e3 * fitted.rms_mm:.2g} µm, closer than any instrument measures"
        if computed
        else f"they are given in the arm's base, of a point {target_mm:.1f} mm from the middle of the flange"
    )
    fact = f"no instrument measured these places: {proof}, so that the controller computed them from its joints"
    remedy = f"give those of an instrument; {OF_CONTROLLER}"
    misfit = Misfit(left_mm, fitted.rms_mm, float(fitted.left_mm.size * np.log(left_mm / max(fitted.rms_mm, 1e-9))))
    columns = ("x_mm", "y_mm", "z_mm")
    yield Finding(SOURCE, "impossible", columns, "the controller's own places", fact, remedy, misfit)
