"""Features of a program with tolerances.

The tolerance of a position is its largest distance from the programmed one, that of a distance the deviation in either
direction. Flatness and straightness are widths of the zone about the least-squares element (ISO 1101): the distance of
two planes, or the diameter of a cylinder.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, cast, get_args

import numpy as np

from analysis.robot.kinematics.arm import Array, Integers
from rigs.errors import FileError, RigError, UseError
from rigs.files import read_bytes

Kind = Literal["position", "distance", "flatness", "straightness"]
_FEWEST: dict[str, int] = {"position": 1, "distance": 2, "flatness": 4, "straightness": 2}
_TOLERANCE = re.compile(r"(\d+(?:\.\d*)?|\.\d+)\s*(mm|[µμ]m|um)")
_SIGN = "FEATURE=0.2mm, such as hole1=0.2mm, distance:hole1,hole2=0.1mm or flatness:P1..P8=0.3mm"
_COLUMNS = ("name", "kind", "targets", "tolerance_mm")
_MOST_BYTES = 1_000_000
_NOMINAL_MM = 0.01
"""Nominal width of a plane or line: the decimals of a program, 0.001 mm, many times over."""


@dataclass(frozen=True)
class Feature:
    """rows: indices in the program's list of targets."""

    name: str
    kind: Kind
    tolerance_mm: float
    rows: Integers
    where: str = ""
    """Argument or line of the table, for errors."""

    def values(self, nominal: Array, moved: Array) -> Array:
        """Error (k,) mm for nominal (m, 3) and k displaced sets of points (k, m, 3)."""
        if self.kind == "position":
            return np.asarray(np.linalg.norm(moved[:, 0] - nominal[0], axis=1))
        if self.kind == "distance":
            return _distances(moved) - _distances(nominal[None])
        return _widths(moved, self.kind == "flatness")


def _distances(points: Array) -> Array:
    """Distance (k,) of the first point from the datum of the others (k, m, 3): a point, line or plane."""
    datum = points[:, 1:]
    middle = datum.mean(axis=1)
    away = points[:, 0] - middle
    if (count := datum.shape[1]) > 1:
        axes = np.linalg.eigh(_scatter(datum))[1]
        away = np.einsum("ki,kia->ka", away, axes[:, :, :1] if count > 2 else axes[:, :, :2])
    return np.asarray(np.linalg.norm(away, axis=1))


def _widths(points: Array, is_plane: bool) -> Array:
    """Width (k,) of the zone about the least-squares plane or line of points (k, m, 3)."""
    axes = np.linalg.eigh(_scatter(points))[1]
    across = (points - points.mean(axis=1, keepdims=True)) @ axes[:, :, : 1 if is_plane else 2]
    return np.asarray(np.ptp(across[..., 0], axis=1) if is_plane else 2 * np.linalg.norm(across, axis=2).max(axis=1))


def _scatter(points: Array) -> Array:
    off = points - points.mean(axis=1, keepdims=True)
    return np.asarray(off.transpose(0, 2, 1) @ off)


def features_of(
    tolerances: Sequence[str], table: Path | None, names: Sequence[str], lines: Sequence[int], places: Array
) -> tuple[list[Feature], list[RigError]]:
    """Features of --tolerance and of a table, and an error for each that is not possible.

    names, lines, places (n, 3) mm: of the targets; NaN if unknown. Raises UseError without any tolerance, and FileError
    for a table without the columns.
    """
    if not tolerances and table is None:
        remedy = "add --tolerance hole1=0.2mm, or --features TABLE.csv"
        raise UseError("rig certify", "has no tolerance", remedy, code="usage")
    written = [(f"--tolerance {text}", "", text) for text in tolerances]
    features, errors = list[Feature](), list[RigError]()
    for where, label, text in [*written, *(_rows_in(table) if table else ())]:
        try:
            name, kind, targets, tolerance_mm = _stated(where, label, text)
            if (kind, targets) == ("position", "all"):
                for row, (target, line) in enumerate(zip(names, lines, strict=True)):
                    unique = target if names.count(target) == 1 else f"{target} in line {line}"
                    features.append(Feature(unique, kind, tolerance_mm, np.array([row]), where))
                continue
            rows = np.array(_rows_of(where, targets, names, lines), dtype=int)
            feature = Feature(name, kind, tolerance_mm, rows, where)
            _check(feature, places[rows])
            features.append(feature)
        except UseError as error:
            errors.append(error)
    return features, errors


def _stated(where: str, label: str, text: str) -> tuple[str, Kind, str, float]:
    """Name, kind, targets and tolerance in mm of a text such as `distance:A,B=0.1mm`."""
    feature, equals, tolerance = (part.strip() for part in text.rpartition("="))
    if not equals or not feature:
        raise UseError(where, "is not FEATURE=MM", f"write {_SIGN}", code="usage")
    if not (match := _TOLERANCE.fullmatch(tolerance)):
        is_number = re.fullmatch(r"[\d.]+", tolerance)
        problem = f"{tolerance!r} has no unit" if is_number else f"{tolerance!r} is not a tolerance in mm or µm"
        raise UseError(where, problem, f"write {_SIGN}", code="usage")
    tolerance_mm = float(match[1]) * (1.0 if match[2] == "mm" else 1e-3)
    if not 0 < tolerance_mm < np.inf:
        problem = f"the tolerance is {tolerance_mm:g} mm"
        raise UseError(where, problem, "give more than 0 mm", code="usage")
    kind, colon, targets = feature.partition(":")
    if colon and kind not in get_args(Kind):
        remedy = f"choose from {', '.join(get_args(Kind))}"
        raise UseError(where, f"{kind!r} is no feature", remedy, code="usage")
    return label or feature, cast("Kind", kind if colon else "position"), targets.strip() or feature, tolerance_mm


def _rows_in(table: Path) -> list[tuple[str, str, str]]:
    """Place, name and text of the features."""
    rows = csv.DictReader(io.StringIO(read_bytes(table, _MOST_BYTES).decode("utf-8-sig", "replace"), newline=""))
    if missing := [name for name in _COLUMNS if name not in (rows.fieldnames or ())]:
        has_no_unit = "tolerance" in (rows.fieldnames or ())
        problem = "has a column tolerance without unit" if has_no_unit else f"has no column {', '.join(missing)}"
        remedy = f"give the columns {','.join(_COLUMNS)}, targets separated by ;"
        raise FileError(str(table), problem, remedy, code="table.invalid")
    return [
        (
            f"{table}, line {rows.line_num}", (row["name"] or "").strip(),
            f"{row['kind']}:{(row['targets'] or '').replace(';', ',')}={row['tolerance_mm']} mm",
        )
        for row in rows
    ]  # fmt: skip


def _check(feature: Feature, nominal: Array) -> None:
    fewest, count = _FEWEST[feature.kind], len(feature.rows)
    if count < fewest or (feature.kind == "position" and count > 1):
        problem = f"has {count} targets, and a {feature.kind} needs {fewest}{' or more' * (feature.kind != 'position')}"
        raise UseError(feature.where, problem, f"write {_SIGN}", code="usage")
    is_form = feature.kind in ("flatness", "straightness") and np.isfinite(nominal).all()
    if is_form and (width := float(_widths(nominal[None], feature.kind == "flatness")[0])) > _NOMINAL_MM:
        element = "plane" if feature.kind == "flatness" else "straight line"
        problem = f"its targets leave a {element} by {width:.3g} mm as programmed"
        raise UseError(feature.where, problem, "choose others", code="usage")


def _rows_of(where: str, targets: str, names: Sequence[str], lines: Sequence[int]) -> list[int]:
    """`A..B` are all targets from A to B."""
    if targets == "all":
        return list(range(len(names)))
    rows: list[int] = []
    for part in targets.split(","):
        ends = [_row_of(where, end.strip(), names, lines) for end in part.split("..")]
        if len(ends) > 2 or ends[-1] < ends[0]:
            remedy = "write FIRST..LAST in the order of the program"
            raise UseError(where, f"{part.strip()!r} is no range of targets", remedy, code="usage")
        rows += range(ends[0], ends[-1] + 1)
    if len(set(rows)) < len(rows):
        problem, remedy = "names a target twice", "name each target once, in the order of the program"
        raise UseError(where, problem, remedy, code="usage")
    return rows


def _row_of(where: str, name: str, names: Sequence[str], lines: Sequence[int]) -> int:
    of_name = [row for row, known in enumerate(names) if known.lower() == name.lower()]
    line = re.fullmatch(r"(?:line )?(\d+)", name)
    if not of_name and line:
        of_name = [row for row, number in enumerate(lines) if number == int(line[1])]
    if len(of_name) == 1:
        return of_name[0]
    problem, remedy = f"{name!r} names no target", "the program has none that rig understands"
    if names:
        first = f"{', '.join(names[:6])}{', …' * (len(names) > 6)}"
        remedy = f"name a target ({first}) or its line, such as line {lines[0]}"
    if of_name:
        problem = f"{name!r} names {len(of_name)} targets"
        remedy = f"name one by its line: {', '.join(f'line {lines[row]}' for row in of_name[:8])}"
    raise UseError(where, problem, remedy, code="usage")
