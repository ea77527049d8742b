"""From a table to the figures of its test: one function for measured and simulated tables alike."""

from __future__ import annotations

from analysis.geometry.hemisphere import target_angles
from analysis.geometry.iso_cube import cube_of, iso9283_of
from analysis.geometry.programs import hemisphere_of
from analysis.kinematics.arm import arm_of
from analysis.measures import path, pose, radial, repeatability, roll, touch, yaw
from analysis.measures.link_angle import CircleResult
from analysis.measures.path import PathResult
from analysis.measures.pose import PoseResult
from analysis.measures.radial import RadialResult
from analysis.measures.repeatability import RepeatabilityResult
from analysis.measures.rig_agreement import hold_targets
from analysis.measures.touch import TouchResult
from analysis.model.predict import model_of
from analysis.noise.spectrum import LapNoise
from analysis.traces.laps import laps_of
from analysis.traces.tables import CircleTable, PathTable, PoseTable, RadialTable, RepeatabilityTable, Table, TouchTable
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.vocabulary import DRIVEN_AXES

Evaluated = CircleResult | RadialResult | RepeatabilityResult | PoseResult | TouchResult | PathResult

TRACKER_U_MM = 0.02
"""Standard uncertainty of one coordinate of a laser tracker at some metres, where a table says nothing of it."""


def evaluate(
    table: Table,
    rig: Rig,
    u_lag_s: float,
    where: str,
    u_gauge_mm: float | None = None,
    like: tuple[LapNoise, LapNoise] | None = None,
) -> Evaluated:
    """The figures of a table. u_gauge_mm: standard uncertainty of one reading, the rig file's where not given; like:
    noise of the angle and of the distance in another run, for a circle of a single lap.

    Raises FileError where it is not a valid measurement of its test.
    """
    if isinstance(table, PoseTable):
        iso = rig.tests.iso9283
        cube = cube_of(rig) if iso and len(rig.robot.axes) == DRIVEN_AXES else None
        arm, instrument = arm_of(rig.robot), iso.instrument if iso else None
        return pose.evaluate(table, arm, TRACKER_U_MM, where=where, cube=cube, instrument=instrument)
    if isinstance(table, PathTable):
        declared = iso9283_of(rig)
        return path.evaluate(table, cube_of(rig), declared.instrument, where, declared.path_speed_mm_s)
    if isinstance(table, TouchTable):
        return touch.evaluate(table, model_of(rig), where)
    u_mm = rig.gauges.g1.accuracy_mm if u_gauge_mm is None else u_gauge_mm
    hold_targets(table, rig, where)
    match table:
        case CircleTable():
            if rig.gauges.g2 is None:
                raise FileError(where, "has one gauge, and an angle needs two", "add gauges.g2 to the rig file")
            of_test = yaw.evaluate if table.test == "yaw" else roll.evaluate
            gauges = rig.gauges
            laps = laps_of(table, rig, where)
            return of_test(laps, gauges.baseline_mm, gauges.baseline_u_mm, u_lag_s, where, like)
        case RadialTable():
            hemisphere = hemisphere_of(rig)
            expected = range(1, len(target_angles(hemisphere)[0]) + 1)
            orientations = hemisphere.orientations
            return radial.evaluate(table, hemisphere.radius_mm, u_mm, where, expected, orientations=orientations)
        case RepeatabilityTable():
            return repeatability.evaluate(table, u_mm, where)
