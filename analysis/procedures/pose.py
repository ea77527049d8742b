"""Pose test: tool poses measured by a tracker compared with the nominal arm, with fitted base and tool.

Base pose (6) and tool position (3) are least-squares estimates from the positions, all rows with equal weight. The tool
orientation (3), if measured, is the mean of the remaining rotation (Moakher 2002, chordal). The error of a pose is
measured minus fitted, in the arm's base. rms_mm is the root mean square length of this vector, not of one coordinate.

Rows with equal joint angles form a group. ISO 9283:1998, 7.2.1: AP is the distance of the group's mean from the fit,
because without a known frame there is no command. 7.2.2: RP is mean + 3 S of the distances from that mean. For each
rotation the largest |mean| and 3 S are given.

Uncertainties: the scatter of a row comes from repeated poses. It differs between poses and has heavy tails
(`analysis.runs.noise.target_scatter`). Without repeats, the instrument's uncertainty is assumed. For errors the scatter
is propagated through the fit. For AP and RP it gives the deviation from the expectation in repeated visits. The figures
are not corrected for noise, because the standards define them by formulas.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from analysis.procedures.checks.columns import FEWEST, judged_by_places, mirror_findings, right_mm
from analysis.procedures.checks.places import (
    DUPLICATES,
    SOURCE,
    WILDNESS,
    duplicate_findings,
    far_poses,
    outlier_findings,
    source_findings,
    without_lost,
)
from analysis.procedures.checks.units import UNITS, impossible, off_in_its_unit, rail_findings, tracker
from analysis.procedures.shared.axis_curves import AxisCurve, axis_curves
from analysis.procedures.shared.lap_curve import SEED
from analysis.procedures.shared.quantity import Quantity, figures_of
from analysis.procedures.shared.result_curves import PoseCurve
from analysis.procedures.shared.scatter_figures import (
    RP_VISITS,
    by_pose,
    distance_figures,
    of_scatter,
    poses_of_cube,
    rp,
)
from analysis.procedures.shared.test_kind import (
    Facts,
    Finders,
    Finding,
    Instruments,
    Labels,
    Outliers,
    PathDeviation,
    Simulation,
    Verdict,
    check_joints,
    check_numbers,
)
from analysis.procedures.simulate import simulated_cube
from analysis.procedures.stops import PlaceTest
from analysis.robot.geometry.iso_cube import Cube, cube_of
from analysis.robot.geometry.pose_setup import PoseSetUp, fit_setup, frame, position_error
from analysis.robot.kinematics.arm import Arm, Array, Integers, Mask, arm_of, forward, transform, without_setup
from analysis.robot.kinematics.joint_limits import wrapped
from analysis.runs.noise.cell_noise import TARGET_MM, TRACKER_U_MM, LogUniform
from analysis.runs.noise.readings import FITTED_SPREADS, extent_of
from analysis.runs.noise.spectrum import DRAWS
from analysis.runs.noise.target_scatter import Scatter, scatter_of
from analysis.runs.stands import STANDSTILL_MM, require_postures, standstill_starts_of_visits
from analysis.runs.tables import (
    CONTROLLER_PLACE,
    CONTROLLER_TURN,
    PoseTable,
    content_order,
)
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.declared_tests import TrackerPose
from rigs.schema.vocabulary import DRIVEN_AXES, Direction

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

SAME_RAD = float(np.radians(0.1))
"""Poses with all joints within this distance are visits of one pose; the remaining difference is corrected."""
_FEWEST = 6
_FEW_POSES = 20
"""Number of poses below which the fit of frame and tool, nine parameters, absorbs much of the error. Chosen."""
_DOUBTFUL_U = 100.0
"""Multiple of u above which an error that exceeds those of nominal constants is doubtful."""
_BLIND = 1e-3
"""Relative singular value below which a direction is undetermined. Lengths and rotations have the same scale."""


@dataclass(frozen=True)
class PoseResult:
    """Result of a pose test. position_mm (n, 3), rotation (n, 3) rad or None: measured minus fitted, in the arm's base.

    placed_mm (n, 3): errors used for AP, in the instrument's frame if known, otherwise equal to position_mm. group
    (n,): from 0. rows (n,): used rows of the table. axes: curves of joints driven one at a time, in both directions.
    """

    setup: PoseSetUp
    position_mm: Array
    rotation: Array | None
    placed_mm: Array
    group: NDArray[np.int64]
    figures: dict[str, Quantity]
    samples: int
    notes: tuple[str, ...]
    rows: Integers
    axes: tuple[AxisCurve, ...] = ()

    @property
    def as_curve(self) -> PoseCurve:
        return PoseCurve(self.position_mm, None if self.rotation is None else np.degrees(self.rotation), self.axes)


def evaluate(
    table: PoseTable,
    arm: Arm,
    u_mm: float,
    where: str = "the pose table",
    same_rad: float = SAME_RAD,
    cube: Cube | None = None,
    instrument: TrackerPose | None = None,
) -> PoseResult:
    """Figures of tracker poses.

    arm: nominal; its base and tool are replaced by the fit, except for AP in a known instrument frame. u_mm: standard
    uncertainty of a coordinate, assumed if no pose was repeated; the uncertainty of the orientation is nan then. cube:
    whose poses have separate figures (`analysis.procedures.shared.scatter_figures`).

    figures: rms_mm, mean_mm, max_mm of the position error; rms_deg, max_deg of the orientation error if measured; for
    repeated poses repeat_mm (pooled scatter of a coordinate), ap_mm and ap_mean_mm and, from three visits on, rp_mm and
    rp_mean_mm (largest and mean over the groups), ap_a_deg, rp_a_deg … of the rotations about the arm's x, y, z (a, b,
    c in the standard); for joints driven one at a time, in both directions, axis3_reversal_deg …
    (`analysis.procedures.shared.axis_curves`). Unmeasured poses are left out (`analysis.procedures.checks.places`).
    Raises FileError.
    """
    _require_enough(table, where)
    order, table = content_order(table), table.in_content_order()
    bare = without_setup(arm)
    table, rows, notes_of_lost = without_lost(table, bare, partial(_errors, bare))
    rows = order[rows]
    T = forward(bare, table.q)
    setup = fit_setup(T, table.xyz_mm)
    position = position_error(T, table.xyz_mm, setup)
    rotation = None
    if table.rpy is not None:
        setup, rotation = _orientation(T, table.rpy, setup)
    shown = np.argsort(rows)
    group = groups(table.q, same_rad, rail=table.rail)
    if (sides := table.sides) is not None:  # a pose approached from two sides counts as two
        group = np.unique(np.column_stack([group, sides]), axis=0, return_inverse=True)[1].ravel()
    again = np.flatnonzero(np.bincount(group) >= 2)
    figures: dict[str, Quantity] = {}
    notes = [
        "every pose was measured once: repeatability is not reported, and the noise of instrument and robot is assumed"
    ]
    place: Scatter | None = None
    turn: Scatter | None = None
    placed, twisted = (position, rotation) if instrument is None else _in_frame(arm, table, instrument)
    if len(again):
        pose = poses_of_cube(table.q, cube)
        figures, notes, place, turn = _of_visits(placed, twisted, group, pose, instrument)
        figures |= distance_figures(pose[shown], table.xyz_mm[shown], cube)  # of cycles, which the order states
    figures = _position_figures(position, setup, _noise(place, group, again, u_mm, TARGET_MM)) | figures
    if rotation is not None:
        of_turn = _noise(turn, group, again, np.nan)
        figures |= figures_of(_angles(rotation), _angles(rotation + np.radians(of_turn)), len(rotation))
    if place is None:
        figures = {name: replace(figure, noise="assumed") for name, figure in figures.items()}
    if rotation is not None and not np.isfinite(figures["rms_deg"].u):
        notes.append("the uncertainty of the instrument in rotation is unknown: figures of the orientation lack u")
    axes, of_axes = ((), {}) if sides is None else axis_curves(table.q, sides, table.xyz_mm, arm.axes)
    figures |= of_axes
    doubts = _doubts(figures["rms_mm"], setup, right_mm(extent_of(table.xyz_mm)))
    notes = [*notes_of_lost, *doubts, *notes]
    rotation = None if rotation is None else rotation[shown]
    return PoseResult(
        setup, position[shown], rotation, placed[shown], group[shown], figures, len(T), tuple(notes),
        rows[shown], axes,
    )  # fmt: skip


def _in_frame(arm: Arm, table: PoseTable, instrument: TrackerPose) -> tuple[Array, Array | None]:
    """Errors (n, 3) mm and (n, 3) rad, or None, with the tool of the rig file and the measured instrument frame."""
    T = np.linalg.inv(arm.T_world_base) @ forward(arm, table.q)
    to_base: Array = np.linalg.inv(arm.T_world_base) @ transform(instrument)
    place = table.xyz_mm @ to_base[:3, :3].T + to_base[:3, 3] - T[:, :3, 3]
    if table.rpy is None:
        return place, None
    setup = PoseSetUp(np.asarray(np.linalg.inv(to_base), dtype=float), np.eye(4), np.empty((0, 9)))
    return place, _remaining_rotations(T, _turns_seen(table.rpy, setup), np.eye(3))


def _of_visits(
    placed: Array, twisted: Array | None, group: NDArray[np.int64], pose: Integers, instrument: TrackerPose | None
) -> tuple[dict[str, Quantity], list[str], Scatter, Scatter | None]:
    """Figures, notes, and the scatter of positions and rotations of repeated poses; pose (n,): number in the cube."""
    counts = np.bincount(group)
    again = np.flatnonzero(counts >= 2)
    seen = _padded(placed, group, again)
    place, turn = scatter_of(seen, 0.0), None
    plain = by_pose(np.array([pose[group == number][0] for number in again]), place_figures)
    figures = of_scatter(plain, seen, place)
    if twisted is not None:
        turned = np.degrees(_padded(twisted, group, again))
        turn = scatter_of(turned, 0.0)
        figures |= of_scatter(turn_figures, turned, turn)
    few = f"{len(again)} poses visited again, at most {counts.max()} times; ISO 9283 requires {RP_VISITS}"
    notes = [few] if counts.max() < RP_VISITS else []
    if instrument is not None:
        for name in [name for name, figure in figures.items() if name[:3] == "ap_" and figure.unit == "mm"]:
            figures[name] = replace(figures[name], u=float(np.hypot(figures[name].u, instrument.u_mm)))
        notes.append("AP is by the tool and the tracker's frame of the rig file; rms and mean of all poses are fitted")
    elif len(counts) <= _FEW_POSES:
        fact = "AP is the residual of a best fit of the tracker frame to these poses, which is smaller than by ISO 9283"
        notes.append(f"{fact}; give tests.iso9283.instrument, a frame that was measured by itself")
    return figures, notes, place, turn


def _errors(bare: Arm, of_fit: PoseTable, table: PoseTable) -> tuple[Array, Array | None]:
    """Errors (n, 3) mm and (n, 3) rad, or None, of a table, with base and tool fitted to a second table."""
    setup = fit_setup(forward(bare, of_fit.q), of_fit.xyz_mm)
    T = forward(bare, table.q)
    position = position_error(T, table.xyz_mm, setup)
    if table.rpy is None or of_fit.rpy is None:
        return position, None
    tool, _ = _orientation(forward(bare, of_fit.q), of_fit.rpy, setup)
    seen = _turns_seen(table.rpy, setup)
    return position, _remaining_rotations(T, seen, tool.T_flange_tool[:3, :3])


_MANY_ROWS = 2000
"""Rows from which a search tree is faster than a comparison of all rows, including the half second of its import."""


def groups(q: Array, same_rad: float, *, rail: bool = False) -> NDArray[np.int64]:
    """Group number (n,) of each row: all joints within same_rad of the group's first row, modulo a turn."""
    number, count = np.full(len(q), -1, dtype=np.int64), 0
    box = np.where(np.arange(q.shape[1]) < q.shape[1] - rail, 2 * np.pi, 0.0)
    places = np.where(box > 0, wrapped(q) % (2 * np.pi) % (2 * np.pi), q)
    near_row = _near_in_tree(places, box, same_rad) if len(q) > _MANY_ROWS else _near_in_table(places, box, same_rad)
    for row in range(len(q)):
        if number[row] < 0:
            near = near_row(row)
            number[near[number[near] < 0]] = count
            count += 1
    return number


def _near_in_table(places: Array, box: Array, same_rad: float) -> Callable[[int], NDArray[np.intp]]:
    """A function from a row to all rows near it. box: period of each column; 0 if it has none."""

    def near_row(row: int) -> NDArray[np.intp]:
        apart = np.abs(places - places[row])
        return np.flatnonzero((np.where(box > 0, np.minimum(apart, box - apart), apart) <= same_rad).all(axis=1))

    return near_row


def _near_in_tree(places: Array, box: Array, same_rad: float) -> Callable[[int], NDArray[np.intp]]:
    from scipy.spatial import cKDTree  # noqa: PLC0415 - takes half a second to import

    tree = cKDTree(places, boxsize=box)
    return lambda row: np.array(tree.query_ball_point(places[row], same_rad, p=np.inf))


def _noise(
    scatter: Scatter | None,
    group: NDArray[np.int64],
    again: NDArray[np.int64],
    u: float,
    stops: LogUniform | None = None,
) -> Array:
    """Draws (m, n, 3) of the noise of all rows: the scatter of the row's group, or of any group.

    If both are unknown, it combines the uncertainty u of the instrument with the usual scatter of robot stops.
    """
    rng = np.random.default_rng(SEED)
    if scatter is None:
        robot = 0.0 if stops is None else stops.low * (stops.high / stops.low) ** rng.uniform(size=(DRAWS, 1, 1))
        level: Array = np.hypot(u, robot)
        return level * rng.standard_normal((DRAWS, len(group), 3))
    place = np.searchsorted(again, group).clip(max=len(again) - 1)
    place = np.where(again[place] == group, place, rng.integers(len(again), size=len(group)))
    return replace(scatter, sd_mm=scatter.sd_mm[:, place]).again(rng, (3,))


def _position_figures(position: Array, setup: PoseSetUp, noise_mm: Array) -> dict[str, Quantity]:
    basis, s, _ = np.linalg.svd(setup.design, full_matrices=False)
    basis = basis[:, s > 1e-9 * s[0]]
    noise = noise_mm.reshape(len(noise_mm), -1)
    drawn = position + (noise - noise @ basis @ basis.T).reshape(noise_mm.shape)
    return figures_of(_lengths(position), _lengths(drawn), len(position))


def _lengths(vectors: Array) -> dict[str, Array]:
    length = np.linalg.norm(vectors, axis=-1)
    return {
        "rms_mm": np.sqrt((length**2).mean(axis=-1)),
        "mean_mm": length.mean(axis=-1),
        "max_mm": length.max(axis=-1),
    }


def _angles(vectors: Array) -> dict[str, Array]:
    length = np.degrees(np.linalg.norm(vectors, axis=-1))
    return {"rms_deg": np.sqrt((length**2).mean(axis=-1)), "max_deg": length.max(axis=-1)}


def place_figures(x: Array) -> dict[str, Array]:
    """Scatter, AP and RP (...,) in mm of position errors x (..., g, 3, n) mm of n visits in g groups, NaN if
    missing."""
    x = np.swapaxes(x, -1, -2)
    mean = np.nanmean(x, axis=-2, keepdims=True)
    away = np.linalg.norm(mean[..., 0, :], axis=-1)
    freedom = (np.isfinite(x).sum(axis=-2) - 1).sum(axis=(-2, -1))
    pooled = np.sqrt(np.nansum((x - mean) ** 2, axis=(-3, -2, -1)) / freedom)
    figures = {"repeat_mm": pooled, "ap_mm": away.max(axis=-1), "ap_mean_mm": away.mean(axis=-1)}
    thrice = _thrice(x)
    if thrice.any():
        repeat = rp(x[..., thrice, :, :])
        figures |= {"rp_mm": repeat.max(axis=-1), "rp_mean_mm": repeat.mean(axis=-1)}
    return figures


def turn_figures(x: Array) -> dict[str, Array]:
    x = np.swapaxes(x, -1, -2)
    figures = {}
    mean, thrice = np.abs(np.nanmean(x, axis=-2)), _thrice(x)
    for column, name in enumerate("abc"):
        figures[f"ap_{name}_deg"] = mean[..., column].max(axis=-1)
        if thrice.any():
            s = np.nanstd(x[..., thrice, :, :][..., column], axis=-1, ddof=1)
            figures[f"rp_{name}_deg"] = 3 * s.max(axis=-1)
    return figures


def _thrice(x: Array) -> NDArray[np.bool_]:
    counts = np.isfinite(x[..., 0]).sum(axis=-1)
    return np.asarray(counts.reshape(-1, counts.shape[-1])[0] >= 3)


def _padded(values: Array, group: NDArray[np.int64], again: NDArray[np.int64]) -> Array:
    visits = [values[group == number] for number in again]
    x = np.full((len(again), 3, max(map(len, visits))), np.nan)
    for row, of_group in enumerate(visits):
        x[row, :, : len(of_group)] = of_group.T
    return x


def _orientation(T: Array, rpy: Array, setup: PoseSetUp) -> tuple[PoseSetUp, Array]:
    from scipy.spatial.transform import Rotation  # noqa: PLC0415 - slow to import, needed here only

    seen = _turns_seen(rpy, setup)
    R_tool = (Rotation.from_matrix(T[:, :3, :3]).inv() * seen).mean().as_matrix()
    whole = frame(R_tool, setup.T_flange_tool[:3, 3])
    return replace(setup, T_flange_tool=whole), _remaining_rotations(T, seen, R_tool)


def _turns_seen(rpy: Array, setup: PoseSetUp) -> Rotation:
    from scipy.spatial.transform import Rotation  # noqa: PLC0415 - slow to import, needed here only

    return Rotation.from_matrix(setup.T_world_base[:3, :3]).inv() * Rotation.from_euler("xyz", rpy)


def _remaining_rotations(T: Array, seen: Rotation, R_tool: Array) -> Array:
    """Rotation vectors (n, 3) rad from flanges with a tool rotation R_tool to the measured rotations."""
    from scipy.spatial.transform import Rotation  # noqa: PLC0415 - slow to import, needed here only

    return np.asarray((seen * (Rotation.from_matrix(T[:, :3, :3]) * Rotation.from_matrix(R_tool)).inv()).as_rotvec())


def _doubts(rms: Quantity, setup: PoseSetUp, right_mm: float) -> list[str]:
    """Doubts about the arm and the fit. right_mm: error of the right arm with nominal constants over these places."""
    doubts = []
    if not (rms.value < right_mm or rms.value < _DOUBTFUL_U * rms.u):
        doubts.append(
            f"the arm of the rig file misses these poses by {rms.value:.3g} mm (rms), {rms.value / rms.u:.0f} times "
            "u: noise cannot cause this, and u does not cover it; check order, signs and zeros of the joints, whether "
            "axes 2 and 3 are coupled (FANUC), and the arm"
        )
    s = np.linalg.svd(setup.design / np.linalg.norm(setup.design, axis=0), compute_uv=False)
    if not s[-1] > _BLIND * s[0]:
        doubts.append(
            "the tool turned too little to distinguish base from tool: do not use their places; the errors are valid"
        )
    return doubts


def _require_enough(table: PoseTable, where: str) -> None:
    if len(table.q) < _FEWEST:
        raise FileError(
            where,
            f"has {len(table.q)} poses, too few to fit base and tool",
            f"give at least {_FEWEST}",
            code="readings.too_few",
        )
    check_numbers(where, q=table.q, xyz_mm=table.xyz_mm)
    if table.rpy is not None:
        check_numbers(where, rpy=table.rpy)
    check_joints(where, table.q, "give poses from the whole working space")
    require_postures(table.q, where)
    if np.ptp(table.xyz_mm, axis=0).max() == 0:
        raise FileError(
            where,
            "the instrument reported the same place in all rows",
            "check that the instrument follows the target",
            code="readings.unsuitable",
        )


class Pose(PlaceTest[PoseTable]):
    """Tool poses measured by a tracker."""

    test = "pose"
    table = PoseTable
    fields = ("q", "xyz_mm")
    optional = ("rpy", "came_from")
    further = (CONTROLLER_PLACE, CONTROLLER_TURN)
    facts = Facts(
        of_places=True,
        of_tracker=True,
        setup_terms=9,
        frame_terms=6,
        wild_spreads=FITTED_SPREADS,
        assumed_sd_mm=0.04,  # UR10, two visits (Landgraf et al. 2021)
    )
    labels = Labels(
        example=("rms_mm", 0.5, 1.0),
        setup="the places of the instrument and of the target on the tool",
        joints_fit="poses fit",
        rows="poses",
        distance_from="from the position computed from the joints",
        outlier_check="check that the tracker saw the target and that the robot was at rest",
    )
    finders: ClassVar[Finders] = {SOURCE: source_findings, WILDNESS: outlier_findings, DUPLICATES: duplicate_findings}

    def stands(self, table: PoseTable) -> Mask:
        far = np.linalg.norm(np.diff(table.xyz_mm, axis=0), axis=1) > STANDSTILL_MM
        return standstill_starts_of_visits(table.q, np.asarray(far | table.lost[1:] | table.lost[:-1]))

    def averaged(self, table: PoseTable, first: Mask, mean: Callable[[Array], Array]) -> PoseTable:
        from scipy.spatial.transform import Rotation  # noqa: PLC0415 - slow to import, needed here only

        averaged = replace(super().averaged(table, first, mean), row=table.rows[first])
        if table.rpy is None:
            return averaged
        turns, stand = table.rpy[first].copy(), np.cumsum(first) - 1
        for number in np.flatnonzero(np.bincount(stand) > 1).tolist():
            turns[number] = Rotation.from_euler("xyz", table.rpy[stand == number]).mean().as_euler("xyz")
        return replace(averaged, rpy=turns)

    def evaluate(self, table: PoseTable, rig: Rig, where: str, instruments: Instruments) -> PoseResult:
        iso = rig.tests.iso9283
        cube = cube_of(rig) if iso and len(rig.robot.axes) == DRIVEN_AXES else None
        return evaluate(
            table, arm_of(rig.robot), TRACKER_U_MM, where, cube=cube, instrument=iso.instrument if iso else None
        )

    def require_evaluable(self, table: PoseTable, rig: Rig, where: str) -> None:
        require_postures(table.q, where)

    def simulated(self, rig: Rig, direction: Direction | None, run: Simulation) -> PoseTable:
        q, xyz_mm, came_from = simulated_cube(rig, run.seed, run.effects)
        return PoseTable(q, xyz_mm, None, came_from=came_from)

    def unit_findings(self, table: PoseTable, rig: Rig, T_tool: Array) -> Iterator[Finding]:
        yield from rail_findings(table, rig)
        yield from mirror_findings(table, rig, UNITS)
        yield from impossible(tracker(table, T_tool))

    def cannot_tell(self, table: PoseTable, rig: Rig) -> str:
        sound = int((~table.lost).sum())
        return "" if sound >= FEWEST else f"{sound} poses are too few; {FEWEST} are needed"

    def judged_joints(self, table: PoseTable, rig: Rig) -> Verdict:
        return judged_by_places(rig, table.q, table.xyz_mm, table.rpy)

    def off_path(self, table: PoseTable, rig: Rig, T_tool: Array) -> PathDeviation | None:
        return off_in_its_unit(T_tool, table.xyz_mm)

    def outliers(self, table: PoseTable, arm: Arm) -> Outliers:
        return far_poses(table, without_setup(arm))
