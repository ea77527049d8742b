"""Path test: tool positions along the paths of the cube seen by a tracker, by ISO 9283:1998, clause 8, and ISO 230-4.

8.2 path accuracy AT: largest distance, over the stations, between the mean of all cycles and the command, across the
path.
8.3 path repeatability RT: largest mean + 3 S of the distances of the cycles from their mean, S with n - 1. 8.5 corners
of
the rectangle: cornering round-off CR, the smallest distance of the path from the corner; corner overshoot CO, the
travel
beyond the corner in the old direction, across the new one; each the largest of the first three cycles, at the worst of
P3,
P4, P5. The standard is not public; clauses and formulas follow public quotations (docs/figures.md).

The large circle is driven in both directions, and a tracker measures its radius: F, the radial deviation from the
nominal radius about the least-squares centre, and D, the mean of both least-squares radii less the nominal (ISO
230-4:2005, clause 3).

u is the deviation of a figure from its expectation in repeated tests with the same scatter. The errors of the
instrument are not included.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from analysis.procedures.checks.lost_poses import DUPLICATES, WILDNESS, outlying_places, repeated_places
from analysis.procedures.driven_paths import DrivenPath, DrivenPaths, driven_paths
from analysis.procedures.facts import Labels
from analysis.procedures.shared.quantity import Quantity
from analysis.procedures.shared.result_curves import PathCurve
from analysis.procedures.shared.scatter_figures import FEWEST_CYCLES, half_width, rp
from analysis.procedures.shared.simulated_iso9283 import simulated_path
from analysis.procedures.shared.test_kind import Instruments, Simulation, TestKind
from analysis.robot.geometry.iso_cube import Cube, PathName, Polygon, Ring, cube_of, iso9283_of
from analysis.robot.kinematics.arm import Array, transform
from analysis.runs.table_layout import PLACE, Layout
from analysis.runs.table_rows import Rows
from analysis.runs.tables import PathTable
from rigs.rig import Rig
from rigs.schema.declared_tests import TrackerPose
from rigs.schema.vocabulary import Direction

CYCLES_ASKED, _CORNER_CYCLES = 10, 3
"""Cycles required by ISO 9283, and those used for corner figures."""
_ASKED: tuple[PathName, ...] = ("line", "rectangle", "circle", "circle_cw", "small_circle")
_SLOWEST, _FASTEST = 0.05, 1.5
"""Limits of the speed relative to the rig file; the programs use 0.1 to 1 of it."""
_JUDGED: tuple[PathName, ...] = ("line", "circle", "small_circle")
_NEAR = 0.3
"""Range after a corner for detecting an overshoot, relative to a side."""
_SPANS = 60
_SEED, _DRAWS = 1, 400


@dataclass(frozen=True)
class PathResult:
    """Result of a path test. driven: paths found. figures: by name. notes: as text. samples: number of positions."""

    driven: DrivenPaths
    cube: Cube
    figures: dict[str, Quantity]
    samples: int
    notes: tuple[str, ...]

    @property
    def as_curve(self) -> PathCurve:
        """Paths station by station."""
        cube, parts = self.cube, list[tuple[Array, ...]]()
        axes = np.stack([cube.level, cube.rising, np.cross(cube.level, cube.rising)])
        names: list[str] = []
        for name, path in self.driven.paths.items():
            mean, many = path.off_mm.mean(axis=0), len(path.places) >= FEWEST_CYCLES
            repeat = rp(np.swapaxes(path.off_mm, 0, 1)) if many else np.full(len(mean), np.nan)
            place = (path.command.at(path.s_mm) - cube.centre_mm) @ axes.T
            share = path.s_mm / path.command.length_mm
            parts.append((path.s_mm, share, place, mean @ axes.T, np.linalg.norm(mean, axis=1), repeat))
            names += [name] * len(mean)
        return PathCurve(np.array(names), *(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def evaluate(
    table: PathTable, cube: Cube, instrument: TrackerPose | None, where: str, speed_mm_s: float | None = None
) -> PathResult:
    """Figures of a path recording.

    NAME_at_mm and NAME_rt_mm of line, circle and small_circle; corner_round_mm, corner_overshoot_mm; f_max_mm,
    f_min_mm, d_mm of the large circle in both directions; speed_mm_s along the line, or the largest path found, doubted
    by a note unless it is a program speed for speed_mm_s. Raises FileError if the recording contains no path of the
    cube.
    """
    driven = driven_paths(table, cube, None if instrument is None else transform(instrument), where)
    paths, figures, u_mm = driven.paths, dict[str, Quantity](), 0.0 if instrument is None else instrument.u_mm
    for name in _JUDGED:
        if name in paths and len(paths[name].places) >= FEWEST_CYCLES:
            figures |= _redone(paths[name].off_mm, lambda off, name=name: at_and_rt(off, name))  # type: ignore[misc]
            accuracy = figures[f"{name}_at_mm"]
            figures[f"{name}_at_mm"] = replace(accuracy, u=float(np.hypot(accuracy.u, u_mm)))
    if "rectangle" in paths:
        figures |= _corners(paths["rectangle"])
    if "circle" in paths and "circle_cw" in paths:
        figures |= _radial(paths["circle"], paths["circle_cw"])
    speeds = next(iter(paths.values())).speed_mm_s
    speed, n = float(speeds.mean()), len(speeds)
    u = float(speeds.std(ddof=1) / np.sqrt(n)) if n > 1 else np.nan
    figures["speed_mm_s"] = Quantity(speed, u, "mm/s", n)
    counts = {name: len(paths[name].places) if name in paths else 0 for name in _ASKED}
    notes = list(driven.notes)
    if min(counts.values()) < CYCLES_ASKED:
        few = ", ".join(f"{name.replace('_', ' ')} {count} times" for name, count in counts.items())
        notes.append(f"ISO 9283 requires {CYCLES_ASKED} cycles, but there are only: {few}")
    if speed_mm_s is not None and not _SLOWEST * speed_mm_s <= speed <= _FASTEST * speed_mm_s:
        ways = f"the programs drive {0.1 * speed_mm_s:g} to {speed_mm_s:g} mm/s"
        remedy = "check that t_s is in s, and path_speed_mm_s of the rig file"
        notes.append(f"the tool went at {speed:.3g} mm/s, and {ways}: {remedy}")
    if instrument is None:
        notes.append(
            "AT and corners are the residuals of a best fit of the tracker's frame to these paths, which is less than "
            "required by ISO 9283; give tests.iso9283.instrument, a frame that was measured separately"
        )
    return PathResult(driven, cube, figures, len(table.t_s), tuple(notes))


def at_and_rt(off_mm: Array, name: str = "path") -> dict[str, Array]:
    """AT and RT (...,) in mm of deviations (..., cycles, stations, 3) mm."""
    accuracy = np.linalg.norm(off_mm.mean(axis=-3), axis=-1).max(axis=-1)
    repeat = rp(np.swapaxes(off_mm, -3, -2)).max(axis=-1)
    return {f"{name}_at_mm": accuracy, f"{name}_rt_mm": repeat}


def _redone(values: Array, plain: Callable[[Array], dict[str, Array]]) -> dict[str, Quantity]:
    """Figures of values (cycles, …), and their deviations from the expectation in repeated tests.

    Each repeated cycle is the mean plus a mixture of the differences between cycles, preserving their correlation along
    the path; the uncertainty of their scatter adds a chi-square draw.
    """
    rng, n = np.random.default_rng(_SEED), len(values)
    mean = values.mean(axis=0)
    away = (values - mean).reshape(n, -1) / np.sqrt(n - 1)
    level = np.sqrt((n - 1) / rng.chisquare(n - 1, _DRAWS))
    tests = [plain(mean + ((s * rng.standard_normal((n, n))) @ away).reshape(values.shape)) for s in level]
    figures = {}
    for name, value in plain(values).items():
        drawn = np.array([float(test[name]) for test in tests])
        figures[name] = Quantity(float(value), half_width(drawn - drawn.mean()), "mm", n)
    return figures


def _corners(rectangle: DrivenPath) -> dict[str, Quantity]:
    """CR and CO from the first three cycles of the standard; u from all cycles.

    Between two positions the chord cuts a right corner by up to half its length: this is the minimum of 2 u.
    """
    assert isinstance(rectangle.command, Polygon)  # noqa: S101 - what the rectangle is
    each = np.array([[corner_of(place, rectangle.command, k) for k in (1, 2, 3)] for place in rectangle.places])
    hidden = float(each[:, :, 2].max()) / 4
    rng, few = np.random.default_rng(_SEED), min(_CORNER_CYCLES, len(each))
    figures = {}
    for column, name in enumerate(("corner_round_mm", "corner_overshoot_mm")):
        of_corners = each[:, :, column]
        drawn = of_corners[rng.integers(len(of_corners), size=(_DRAWS, few))].max(axis=(1, 2))
        u = half_width(drawn - drawn.mean()) if len(of_corners) > few else np.nan
        u = float(np.hypot(u, hidden)) if name == "corner_round_mm" else u
        figures[name] = Quantity(float(of_corners[:few].max()), u, "mm", few)
    return figures


def corner_of(places: Array, command: Polygon, knot: int) -> tuple[float, float, float]:
    """CR and CO in mm of one pass, positions (n, 3) mm, at a corner of a polygon, and the spacing of the
    positions there."""
    corner, before, after = command.knots[knot], command.knots[knot - 1], command.knots[knot + 1]
    old, new = (corner - before) / np.linalg.norm(corner - before), (after - corner) / np.linalg.norm(after - corner)
    reach = _NEAR * float(np.linalg.norm(after - corner))
    away = places - corner
    near = np.flatnonzero(np.linalg.norm(away, axis=1) < reach)
    if len(near) < 2:
        return np.nan, np.nan, np.nan
    first, last = int(near[0]), int(near[-1]) + 1
    begin, step = away[first : last - 1], np.diff(away[first:last], axis=0)
    share = np.clip(-(begin * step).sum(axis=1) / np.maximum((step**2).sum(axis=1), 1e-12), 0.0, 1.0)
    off = np.linalg.norm(begin + share[:, None] * step, axis=1)
    cut, apart = float(off.min()), float(np.linalg.norm(step[off.argmin()]))
    along, beyond = away[first:last] @ new, away[first:last] @ old
    aside = away[first:last] @ np.cross(old, new)
    passed = (along >= 0) & (along < reach)
    if not passed.any():
        return cut, 0.0, apart
    span = np.minimum((along[passed] / reach * _SPANS).astype(np.int64), _SPANS - 1)
    count = np.maximum(np.bincount(span, minlength=_SPANS), 1)
    y, x = (np.bincount(span, away[passed], minlength=_SPANS) / count for away in (beyond, aside))
    return cut, float(np.where(y > 0, np.hypot(x, y), 0.0).max()), apart


def _radial(acw: DrivenPath, cw: DrivenPath) -> dict[str, Quantity]:
    """F and D of the large circle in both directions, with stations at equal positions."""
    ring, n = acw.command, min(len(acw.places), len(cw.places))
    stations = min(len(acw.s_mm), len(cw.s_mm))
    if not isinstance(ring, Ring) or n < FEWEST_CYCLES or len(acw.s_mm) != len(cw.s_mm):
        return {}
    parts = []
    for way in (acw, cw):
        outwards = (way.command.at(way.s_mm) - ring.centre) / ring.radius_mm
        radial = (way.off_mm[:n] * outwards).sum(axis=2)
        angle = np.arctan2(outwards @ ring.v, outwards @ ring.u)
        parts.append((radial, np.stack([np.cos(angle), np.sin(angle)], axis=1)))
    waves = np.concatenate([parts[0][1], parts[1][1]])
    # One constant per direction and a common centre, as for a bidirectional least-squares circle.
    level = np.repeat(np.eye(2), stations, axis=0)
    back = np.linalg.pinv(np.hstack([level, waves]))

    def plain(both: Array) -> dict[str, Array]:
        mean = both.mean(axis=-2)
        fit = mean @ back.T
        centred = mean - fit[..., 2:] @ waves.T
        return {"f_max_mm": centred.max(axis=-1), "f_min_mm": centred.min(axis=-1), "d_mm": fit[..., :2].mean(axis=-1)}

    return _redone(np.hstack([parts[0][0], parts[1][0]]), plain)


class Path(TestKind[PathTable]):
    """Tool positions along the paths of the cube, seen by a tracker."""

    test = "path"
    labels = Labels(
        example=("line_at_mm", 0.5, 1.0),
        unsupported_reason="is a path without joint angles, which cannot show single joints",
    )
    finders = ((WILDNESS, outlying_places), (DUPLICATES, repeated_places))

    def layout(self, axes: int = 6, *, rail: bool = False) -> Layout:
        return Layout(("t_s", *PLACE))

    def table_of(self, rows: Rows, direction: Direction | None, where: str) -> PathTable:
        return PathTable(rows.floats("t_s"), rows.stack(PLACE))

    def columns(self, table: PathTable) -> Mapping[str, Array]:
        return {"t_s": table.t_s, **dict(zip(PLACE, table.xyz_mm.T, strict=True))}

    def evaluate(self, table: PathTable, rig: Rig, where: str, instruments: Instruments) -> PathResult:
        declared = iso9283_of(rig)
        return evaluate(table, cube_of(rig), declared.instrument, where, declared.path_speed_mm_s)

    def require_evaluable(self, table: PathTable, rig: Rig, where: str) -> None:
        """Check that the recording contains paths of the cube."""
        driven_paths(table, cube_of(rig), None, where)

    def simulated(self, rig: Rig, direction: Direction | None, run: Simulation) -> PathTable:
        return PathTable(*simulated_path(rig, run.seed, run.effects))
