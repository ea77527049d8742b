"""Detection of columns in a wrong unit, and of unsigned values.

A wrong unit is claimed only for data that are impossible as labelled and correct with the alternative unit. An unlikely
label causes only a doubt. The two gauges on a circle reveal each other's unit: at circle angle phi their mean is R -
e_u cos(phi) - e_v sin(phi) for an eccentricity e, and each gauge shows the same e in yaw and roll. Positions and angles
of a tracker and a rail are compared with the motion of the robot in any frame.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import product

import numpy as np

from analysis.procedures.checks.columns import (
    CLEARLY,
    FEWEST,
    RIGHT_MM,
    left_mm,
    most_distant_rows,
    off_circle,
    off_places,
    steps,
)
from analysis.procedures.shared.test_kind import Finding, PathDeviation, kind_of
from analysis.robot.geometry.circle import frame_of
from analysis.robot.kinematics.arm import Array, arm_of, forward, rail_mm, without_setup
from analysis.robot.kinematics.joint_limits import impossible_rad
from analysis.runs.noise.readings import evenly
from analysis.runs.tables import CircleTable, PoseTable, Table, format_of
from rigs.rig import Rig
from rigs.schema.modbus import ValueRegister
from rigs.signedness import unsigned_readings

UNITS = "units"
_MM_PER = {"inches": 25.4, "µm": 1e-3, "m": 1000.0, "cm": 10.0}
_OF_GAUGES = ("inches", "µm")
_WRITTEN_AS = {unit: 1 / mm for unit, mm in _MM_PER.items()}
"""Factor from a length in mm to another unit."""
_READ_AS = {unit: _MM_PER[unit] for unit in ("inches", "cm")}
"""Factor for a length in mm misread in another unit, for example by an import map; m looks like µm."""
_OF_RAILS = ("m", "inches", "cm")
_ECCENTRIC_MM = 0.2
"""Smallest examined eccentricity. A smaller one may differ between the gauges because of robot errors."""
_LIKE_STATED = 0.3
"""Largest relative difference from the stated eccentricity. Robot errors of 0.1 mm cause less, a wrong unit causes
25 times more.
"""
_TRAVEL_RATIO = 2.0
"""Largest ratio of the travel of two gauges in the same unit; in different units it is 25."""


def circle_gauges(table: CircleTable, rig: Rig, T: Array) -> Iterator[tuple[str, str]]:
    """Faults of the gauges of a circle, each with a remedy."""
    circle = rig.tests.circle
    if circle is None:
        return
    for name, reading in zip(("g1_mm", "g2_mm"), table.g_mm.T, strict=False):
        yield from impossible_travel(name, reading, circle.radius_mm)
    off = off_circle(T, circle)
    if table.g_mm.shape[1] < 2 or rig.gauges.g2 is None or off is None or not off.on:
        return
    frame = frame_of(circle)
    phi = frame.angle(T[:, :3, 3])
    if np.ptp(phi) < 2 * np.pi * 0.9 or len(phi) < 12:
        return
    # Eccentricity along phi = 0° and 90° from each gauge, rotated in a yaw test by w/R to either side.
    design = np.stack([np.ones_like(phi), np.cos(phi), np.sin(phi)], axis=1)
    waves: Array = -np.linalg.lstsq(design, table.g_mm, rcond=None)[0][1:].T
    # Both gauges follow the same ball. They therefore see waves of the same size and direction, and have equal travel.
    # Errors of a robot may cancel the wave of a gauge, but not the rest of the reading.
    # an outlier caused by a chip under the probe does not count
    low, high = np.quantile(table.g_mm, [0.05, 0.95], axis=0)
    travel, size = high - low, np.linalg.norm(waves, axis=1)
    seen = size.min() > 0 and size.max() >= _ECCENTRIC_MM and waves[0] @ waves[1] >= 0
    for unit, k in product(_OF_GAUGES, (0, 1)) if seen else ():
        factor, ratio = _WRITTEN_AS[unit], size[k] / size[1 - k]
        as_far = 1 / _TRAVEL_RATIO < travel[k] / factor / max(travel[1 - k], 1e-9) < _TRAVEL_RATIO
        if abs(ratio / factor - 1) < 0.1 and as_far:
            fact = f"g{k + 1}_mm is in {unit}: its wave over the circle is {ratio:.3g} times that of the other gauge"
            yield fact, "convert it to mm"
    # If the rig file states the eccentricity, compare it with the data in other units.
    stated_mm = np.array([np.dot(circle.eccentricity_mm, frame.u), np.dot(circle.eccentricity_mm, frame.v)])
    size_mm = float(np.linalg.norm(stated_mm))
    for unit in _OF_GAUGES if size_mm >= _ECCENTRIC_MM else ():
        factor = _WRITTEN_AS[unit]
        if np.linalg.norm(waves.mean(axis=0) / factor - stated_mm) < _LIKE_STATED * size_mm:
            fact = f"g1_mm and g2_mm are in {unit}: their wave is {factor:.3g} times the eccentricity of the rig file"
            yield fact, "convert them to mm"


def impossible_travel(name: str, reading: Array, radius_mm: float) -> Iterator[tuple[str, str]]:
    """Fault and remedy if a reading travels further than the radius, which is impossible with a link."""
    travel = float(np.ptp(reading))
    if travel > radius_mm:
        fact = f"{name} travels {travel:.4g} mm on a radius of {radius_mm:g} mm, which is impossible for a link"
        if wrapped := unsigned_readings(reading):
            unsigned, remedy = wrapped
            yield f"{fact}: {unsigned}", remedy
            return
        yield fact, "convert it to mm: the values are probably µm" if travel > 3 * radius_mm else "check the unit"


_ABOUT = 0.3
"""Largest relative difference between equal distances.

The rig file may lack the target of the tracker, so the distances agree only roughly.
"""
_SAME_TURN_RAD = 0.01
"""Largest median difference between the rotation angles of tracker and robot between poses, …"""
_FARTHER = 8.0
"""An angle convention is wrong if its difference exceeds this limit, and that of another convention by this factor."""


def tracker(table: PoseTable, T: Array) -> Iterator[tuple[str, str]]:
    rows = most_distant_rows(table.xyz_mm)
    robot_step, seen = (float(np.median(steps(places, rows))) for places in (T[:, :3, 3], table.xyz_mm))
    for factors, are_in, remedy in (
        (_WRITTEN_AS, "are in", "convert the places to mm"),
        (_READ_AS, "were not in", "read them as mm"),
    ):
        for unit, factor in factors.items():
            if robot_step > 1.0 and abs(seen / robot_step / factor - 1) < _ABOUT:
                far = f"they move {seen / robot_step:.3g} times as far as the robot"
                yield f"x_mm, y_mm, z_mm {are_in} {unit}: {far}", remedy
    if table.rpy is None:
        return
    from scipy.spatial.transform import Rotation  # noqa: PLC0415 - slow to import, needed here only

    # Difference between the robot's rotations and the angles as read, and with other units and orders.
    turned, rpy = _turns(T[:, :3, :3], rows), table.rpy
    turns = (
        _turns(Rotation.from_euler(order, angles).as_matrix(), rows)
        for order, angles in (("xyz", rpy), ("xyz", np.degrees(rpy)), ("XYZ", rpy))
    )
    as_read, in_radians, about_moving = (float(np.median(np.abs(turn - turned))) for turn in turns)
    right = 0.0 if as_read < _SAME_TURN_RAD else min(_SAME_TURN_RAD, as_read / _FARTHER)
    if in_radians < right:
        yield (
            "rx_deg, ry_deg, rz_deg are in radians: only then do they fit the motion of the robot",
            "convert them to degrees",
        )
    if about_moving < right:
        fact = "rx_deg, ry_deg, rz_deg are rotations about moving axes: only then do they fit the motion of the robot"
        yield fact, "convert them to roll-pitch-yaw about fixed axes, R = Rz Ry Rx"


def off_in_its_unit(T: Array, xyz_mm: Array) -> PathDeviation | None:
    factors = (1.0, *_WRITTEN_AS.values(), *_READ_AS.values())
    every = [off for factor in factors if (off := off_places(T, xyz_mm / factor))]
    return min(every, key=lambda off: off.off, default=None)


def _turns(R: Array, rows: int) -> Array:
    """Angle (n,) rad between each rotation and the one `rows` rows before, which is equal in every frame."""
    trace = np.einsum("nij,nij->n", R, np.roll(R, rows, axis=0))
    return np.asarray(np.arccos(np.clip((trace - 1) / 2, -1.0, 1.0)))


_POSES, _RAIL_STEPS = 200, 30
"""Number of poses that reveal a unit, and number of fit steps."""


def rail_findings(table: PoseTable, rig: Rig) -> Iterator[Finding]:
    """A finding if the rail positions of poses fit in a different unit, or exceed the rail."""
    arm = without_setup(arm_of(rig.robot))
    if rig.robot.rail is None or table.q.shape[1] == arm.axes:
        return
    if len(table.q) >= FEWEST:
        kept = evenly(len(table.q), _POSES)

        def misfit_mm(factor: float) -> float:
            q: Array = table.q[kept] * np.append(np.ones(arm.axes), factor)
            return left_mm(arm, q, table.xyz_mm[kept], _RAIL_STEPS)

        as_read = misfit_mm(1.0)
        for unit in _OF_RAILS if as_read > CLEARLY * RIGHT_MM else ():
            if (meant := misfit_mm(_MM_PER[unit])) < RIGHT_MM:
                fact = (
                    f"e1_mm is in {unit}: only then do these poses fit (error {meant:.2g} instead of {as_read:.0f} mm)"
                )
                yield Finding("units", "impossible", ("e1_mm",), unit, fact, "convert it to mm")
                return
    stands, (low, high) = rail_mm(arm, table.q), rig.robot.rail.limits_mm
    if stands.min() < low or stands.max() > high:
        reach = f"{stands.min():.6g} to {stands.max():.6g} mm"
        fact = f"e1_mm ranges from {reach}, but robot.rail.limits_mm from {low:g} to {high:g} mm"
        yield Finding("units", "likely", ("e1_mm",), "another unit", fact, "check the unit, or correct limits_mm")


_TURN_RAD = 2 * np.pi + 0.1
_MUCH_MORE = 2.0
"""Factor by which the deviation from the path must exceed that of another joint convention, in any unit of the
tracker. Radians read as degrees move the arm so little that metres look like inches.
"""
_UNLIKELY = 0.1
"""Gauge travel at targets, as a share of the radius, that is too large for errors of an arm."""
_UNIT_ROWS = 20_000
"""Number of rows sufficient to reveal a unit; a run may have millions."""


def unit_findings(table: Table, rig: Rig) -> Iterator[Finding]:
    if most := impossible_rad(table.q):
        columns = tuple(f"q{axis}_deg" for axis in range(1, table.q.shape[1] + 1))
        fact = f"a joint would be at {np.degrees(most):.0f}°: degrees were read as radians"
        yield Finding(UNITS, "impossible", columns, "degrees", fact, "read them as degrees")
        return
    table = table.thinned(_UNIT_ROWS)
    arm = arm_of(rig.robot)
    places = forward(arm, table.q)
    # True if the robot performs the test only if q is in rad instead of degrees.
    degrees = np.degrees(table.q)
    ways: tuple[Array, ...] = (places, forward(arm, degrees)) if np.abs(degrees).max() <= _TURN_RAD else ()
    wrong, right = [kind_of(table.test).off_path(table, rig, T) for T in ways] or (None, None)
    if wrong and right and right.on and wrong.off > _MUCH_MORE * right.off:
        columns = tuple(f"q{axis}_deg" for axis in range(1, arm.axes + 1))
        fact = f"q1_deg … {columns[-1]} are in radians: only then do the readings fit the robot of the rig file"
        yield Finding(UNITS, "impossible", columns, "radians", fact, "convert them to degrees")
        yield from kind_of(table.test).unit_findings(table, rig, forward(arm, degrees))
        return
    yield from kind_of(table.test).unit_findings(table, rig, places)


def unsigned_findings(table: Table, rig: Rig) -> Iterator[Finding]:
    readings, gauges = table.readings, format_of(table.test).gauges
    for name, column in zip(gauges, readings.T, strict=False):
        value = getattr(dict(rig.gauges).get(name), "value", None)
        shown = unsigned_readings(column, [value.scale] if isinstance(value, ValueRegister) else [])
        if shown is not None:
            fact, remedy = shown
            fact, remedy = f"{name}_mm: {fact} mm", f"{remedy}, and read {name} again"
            yield Finding(UNITS, "decisive", (f"{name}_mm",), "signed values", fact, remedy)


def impossible(mistakes: Iterable[tuple[str, str]]) -> Iterator[Finding]:
    for fact, remedy in mistakes:
        columns = tuple(name.strip(",:") for name in fact.split() if "_" in name)
        yield Finding(UNITS, "impossible", columns, "another unit", fact, remedy)


def target_units(g_mm: Array, radius_mm: float) -> Iterator[Finding]:
    yield from impossible(impossible_travel("g1_mm", g_mm, radius_mm))
    travel = float(np.ptp(g_mm))
    if _UNLIKELY * radius_mm <= travel <= radius_mm:
        fact = f"g1_mm travels {travel:.4g} mm on a radius of {radius_mm:g} mm, more than any robot error"
        yield Finding(UNITS, "likely", ("g1_mm",), "another unit", fact, "check the unit")
