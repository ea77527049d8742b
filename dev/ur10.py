"""The UR10 measured by Fraunhofer IPA with a laser tracker (Landgraf et al., CASE 2021): real data for every test.

Writes the poses as CSV tables of docs/tables.md, which `rig import` takes. A tracker pose is six numbers, so a ball
placed anywhere gives real readings: the distance from ball to tool, and the yaw and roll angles of a link to it. Those
are fitted here, judged on poses left out in groups.
"""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from scipy.spatial.transform import Rotation

from analysis.files.write import write_csv, write_new
from analysis.geometry.ball_link import readings
from analysis.geometry.pose_setup import fit_setup
from analysis.geometry.programs import circle_of, hemisphere_of
from analysis.inference.calibrate import Calibration, calibrate
from analysis.inference.observation import Observation, observe
from analysis.inference.setups import split
from analysis.kinematics.arm import Array, arm_of, forward
from analysis.model.hysteresis import Motion
from analysis.model.predict import Path as Driven
from analysis.model.predict import model_of
from analysis.traces.csv_tables import columns_of
from analysis.traces.tables import CircleTable, PoseTable, RadialTable
from rigs.load import load
from rigs.rig import Rig
from rigs.schema.robot import Pose

JOINTS = ("shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint", "wrist_3_joint")
DATA = Path(__file__).parents[2] / "shared" / "data" / "ipa-ur10"
"""Where the measured data lie unless another folder is given; they are not part of the project."""
LINK_MM = 400.0
FACING = np.radians(60)
"""A link cannot lean further away from the tool than this."""
FIT = "joint_offset,link_geometry"


def read(path: Path) -> PoseTable:
    """A series as a pose table. The file turns about moving axes x, y, z; tables about fixed ones."""
    with path.open(encoding="utf-8") as file:
        rows = [
            {key: value.replace(",", ".") for key, value in row.items()} for row in csv.DictReader(file, delimiter=";")
        ]
    column = {name: np.array([float(row[name]) for row in rows]) for name in rows[0] if name != "Timestamp"}
    turned = np.stack([column[f"measurement_r{axis}"] for axis in "xyz"], axis=1)
    rpy = Rotation.from_euler("XYZ", turned, degrees=True).as_euler("xyz")
    q = np.stack([column[name] for name in JOINTS], axis=1)
    return PoseTable(q, np.stack([column[f"measurement_{axis}"] for axis in "xyz"], axis=1), rpy)


def placed(table: PoseTable, rig: Rig, test: str) -> tuple[Rig, Observation]:
    """Readings that a link from a ball in front of the poses would give, and the rig with that ball and that tool."""
    T, tool_mm = in_world(table, rig)
    place, n = T[:, :3, 3], len(table.q)
    ball = place.mean(axis=0) + T[:, :3, 2].mean(axis=0) * LINK_MM
    rig = with_ball(rig, ball, tool_mm)
    zero = np.zeros(n)
    motion = Driven(Motion(zero, table.q), np.arange(n))
    if test == "radial":
        g_mm = (np.linalg.norm(place - ball, axis=1) - LINK_MM)[:, None]
        one = np.ones(n, dtype=np.int64)
        radial = RadialTable(one, zero, zero, one, zero, table.q, g_mm[:, 0])
        return rig, Observation(radial, motion, np.arange(n), g_mm, test)
    facing = np.einsum("ni,ni->n", ball - place, T[:, :3, 2]) / np.linalg.norm(ball - place, axis=1)
    rows = np.flatnonzero(facing > np.cos(FACING))
    offsets = np.array([gauge.offset_mm for _, gauge in rig.gauges])
    g_mm = readings(T, ball, offsets, test, circle_of(rig).radius_mm)  # type: ignore[arg-type]
    circle = CircleTable(test, "acw", zero, table.q, g_mm)  # type: ignore[arg-type]
    return rig, Observation(circle, motion, rows, g_mm[rows], test)


def in_world(table: PoseTable, rig: Rig) -> tuple[Array, Array]:
    """Measured tool poses (n, 4, 4) in the robot's world, turned like its flange; the tool's place (3,) mm on it."""
    flange = forward(replace(arm_of(rig.robot), T_flange_tool=np.eye(4)), table.q)
    setup = fit_setup(flange, table.xyz_mm)
    R_robot = setup.T_world_base[:3, :3].T @ Rotation.from_euler("xyz", table.rpy).as_matrix()
    R_tool = Rotation.from_matrix(np.swapaxes(flange[:, :3, :3], 1, 2) @ R_robot).mean().as_matrix()
    T = np.zeros_like(flange)
    T[:, :3, :3] = R_robot @ R_tool.T
    T[:, :3, 3] = (table.xyz_mm - setup.T_world_base[:3, 3]) @ setup.T_world_base[:3, :3]
    T[:, 3, 3] = 1.0
    return T, setup.T_flange_tool[:3, 3]


def with_ball(rig: Rig, ball: Array, tool_mm: Array) -> Rig:
    """The rig with that tool, and circle and hemisphere about that ball."""
    centre = tuple(ball.tolist())
    tests = rig.tests.model_copy(
        update={
            "circle": circle_of(rig).model_copy(update={"centre_mm": centre}),
            "hemisphere": hemisphere_of(rig).model_copy(update={"centre_mm": centre, "radius_mm": LINK_MM}),
        }
    )
    robot = rig.robot.model_copy(update={"tool": Pose(xyz_mm=tuple(tool_mm.tolist()))})
    return rig.model_copy(update={"robot": robot, "tests": tests})


def judged(rig: Rig, one: Observation, *, groups: bool) -> Calibration:
    """24 DH parameters fitted on 70 % of the poses, judged on the rest."""
    used, left_out = split(one, 0.3, groups=groups, seed=0)
    return calibrate(rig, [used], [left_out], FIT)


def told(what: str, found: Calibration) -> str:
    """A line: rms on the readings left out, before and after."""
    seen = f"{found.identified_combinations} combinations of 24 are determined"
    return f"  {what}: nominal {found.before_mm[1]:.3f} mm, 24 DH parameters {found.after_mm[1]:.3f} mm rms ({seen})"


def main(
    data: Annotated[Path, typer.Argument(help="The folder of series_b.csv and series_d.csv.")] = DATA,
    out: Annotated[Path, typer.Argument(help="Where the tables are written.")] = Path("ur10-tables"),
) -> None:
    """Write the tables and judge calibrations of them, by test."""
    rig = load("ur10")[0]
    for series in ("b", "d"):
        table = read(data / f"series_{series}.csv")
        out.mkdir(parents=True, exist_ok=True)
        path = out / f"ur10-{series}.csv"
        path.unlink(missing_ok=True)
        write_new(path, lambda file, table=table: write_csv(columns_of(table), file))
        print(f"series {series.upper()}: {len(table.q)} poses; wrote {path}")
        whole = observe(model_of(rig), table, f"series {series}")
        print(told("pose, 30 % left out at random", judged(rig, whole, groups=False)))
        print(told("pose, 30 % left out in groups", judged(rig, whole, groups=True)))
        for test in ("radial", "yaw", "roll"):
            print(told(f"{test} with a ball placed, in groups", judged(*placed(table, rig, test), groups=True)))


if __name__ == "__main__":
    typer.run(main)
