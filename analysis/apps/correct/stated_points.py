"""Statements of the user on the origin of points: computed or taught, changes since then, and exceptions by name."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from analysis.apps.correct.entered_values import values_in
from analysis.apps.makers.reading import refuse_converted, refuse_marked
from analysis.correction.point_origins import (
    ChangedArm,
    ComputedPoints,
    ConvertedPoints,
    PointKind,
    PointOrigin,
    UnchangedPoints,
)
from analysis.correction.support import supports
from analysis.robot.kinematics.arm import arm_of, controller_robot
from rigs.errors import FileError, UseError
from rigs.load import load
from rigs.rig import Rig
from rigs.text import first_of, nearest

KINDS: Mapping[PointKind, str] = {
    "computed": "from CAD, offline programming, a vision system, or a frame touched with an instrument",
    "taught": "the arm was jogged until the tool was right, and the pendant stored the point",
}
_SHOWN = 5
_SAME_TYPE_MM, _SAME_TYPE_RAD = 10.0, np.radians(3.0)
"""Largest difference of a constant between arms of one type. Chosen: ten times the largest of 19 delivered arms of
Universal Robots (docs/evidence/real-arms.md)."""


@dataclass(frozen=True)
class Exceptions:
    """Names of points with the other origin. `*` and `?` stand for any characters and for one; brackets for
    themselves."""

    option: str
    names: tuple[str, ...] = ()

    def matching(self, file: str, line: int, name: str) -> set[str]:
        """The names that mean a point, which is also called FILE:NAME and FILE:LINE."""
        called = [text.casefold() for text in (name, f"{file}:{name}", f"{file}:{line}")]
        return {given for given in self.names if any(_pattern(given).fullmatch(text) for text in called)}


def _pattern(name: str) -> re.Pattern[str]:
    wild = {r"\*": ".*", r"\?": "."}
    return re.compile(re.sub(r"\\[*?]", lambda of: wild[of[0]], re.escape(name.casefold())))


@dataclass(frozen=True)
class StatedPoints:
    """Origins of the points of programs, as stated by the user."""

    origin: PointOrigin
    other: PointOrigin
    """Of the exceptions."""
    exceptions: Exceptions

    def is_taught(self, file: str, line: int, name: str) -> bool:
        is_other = bool(self.exceptions.names and self.exceptions.matching(file, line, name))
        return (self.origin.kind == "taught") != is_other

    def is_right(self, file: str, line: int, name: str) -> bool:
        """True if a point is right as it is."""
        return self.of_kind("taught" if self.is_taught(file, line, name) else "computed").is_unchanged

    def of_kind(self, kind: PointKind) -> PointOrigin:
        return self.origin if self.origin.kind == kind else self.other

    @property
    def stated(self) -> tuple[PointOrigin, ...]:
        """The origins that points may have."""
        return (self.origin, self.other) if self.exceptions.names else (self.origin,)

    @property
    def then(self) -> Rig:
        """Rig whose controller placed the points."""
        return self.origin.then

    @property
    def uses_model(self) -> bool:
        """True if the model of the rig corrects any points."""
        return any(not origin.is_exact for origin in self.stated)

    @property
    def are_computed(self) -> bool:
        """True if all points are computed, so that zeros and constants at the controller are an alternative."""
        return all(isinstance(origin, ComputedPoints) for origin in self.stated)

    def refuse_repeated(self, program: Path) -> None:
        """Raise FileError for a program that rig has corrected or converted in the same way already."""
        if any(isinstance(origin, ComputedPoints) for origin in self.stated):
            refuse_marked(program)
        for origin in self.stated:
            if origin.digest:
                refuse_converted(program, origin.digest)

    def refuse_unmatched(self, points: Sequence[tuple[str, int, str]]) -> None:
        """Raise UseError for an exception that names no point (file, line, name) of the programs, or different points
        of several files.
        """
        names = sorted({name for *_, name in points})
        for given in self.exceptions.names:
            files = sorted({point[0] for point in points if given in self.exceptions.matching(*point)})
            if len(files) > 1 and given.casefold() in map(str.casefold, names):
                problem = f"is a point of {len(files)} files: {first_of(files, _SHOWN)}"
                remedy = f"give {files[0]}:{given} for one of them, or *:{given} for all"
                raise UseError(f"{self.exceptions.option} {given}", problem, remedy)
            if not files:
                near = nearest(given, names) or names[:_SHOWN]
                problem = "no point of the programs has this name"
                remedy = f"give a name of the program, such as {', '.join(near)}" if near else "remove it"
                raise UseError(f"{self.exceptions.option} {given}", problem, remedy)


def computed_points(rig: Rig) -> StatedPoints:
    """Every point is computed, as in programs that rig writes."""
    return StatedPoints(ComputedPoints(rig, tuple(supports(rig))), UnchangedPoints(rig), Exceptions("--taught"))


def points_of(
    rig: Rig,
    kind: PointKind,
    since: Path | None = None,
    computed_names: Sequence[str] = (),
    taught_names: Sequence[str] = (),
) -> StatedPoints:
    """Origins by the options of the user. Raises UseError for options that contradict each other, and FileError for a
    file of changes that cannot be used."""
    exceptions: dict[PointKind, Exceptions] = {
        "computed": Exceptions("--taught", _names(taught_names)),
        "taught": Exceptions("--computed", _names(computed_names)),
    }
    other: PointKind = "taught" if kind == "computed" else "computed"
    if (unused := exceptions[other]).names:
        problem = f"all points are {kind} already (--points {kind})"
        remedy = f"name the {other} points with --{other}, or state --points {other}"
        raise UseError(unused.option, problem, remedy)
    if since and kind == "computed" and not exceptions[kind].names:
        problem = "states changes since points were taught, and all points are computed"
        raise UseError("--since", problem, "state --points taught, or name points with --taught")
    taught = taught_origin(rig, since)
    right: PointOrigin = ComputedPoints(rig, tuple(supports(rig)))
    if isinstance(taught, ConvertedPoints):  # the values correct computed points; new numbers would correct twice
        right = UnchangedPoints(rig, taught.since)
    stated = StatedPoints(*((right, taught) if kind == "computed" else (taught, right)), exceptions[kind])
    if len({controller_robot(origin.then.robot).axes for origin in stated.stated}) > 1:
        problem = f"states a controller with other constants than {rig.name}, so both kinds of points need a call each"
        remedy = "correct the taught and the computed points with separate calls"
        raise UseError("--since", problem, remedy)
    return stated


def _names(texts: Sequence[str]) -> tuple[str, ...]:
    return tuple(name.strip() for text in texts for name in text.split(",") if name.strip())


def taught_origin(rig: Rig, since: Path | None) -> PointOrigin:
    """Origin of points taught with the arm, before the changes that a file states."""
    if since is None:
        return UnchangedPoints(rig)
    if not _is_rig_file(since):
        return ConvertedPoints(rig, values_in(rig, since))
    then, _ = load(since)
    if not _is_same_type(then, rig):
        problem = f"is of a different type of arm ({then.robot.name}) than {rig.robot.name}"
        raise FileError(str(since), problem, "give a calibration of this type of arm", code="robot.other")
    for name, each in ((str(since), then), (rig.name, rig)):
        if each.calibrated is None and not any(effect.found for effect in each.effects):
            remedy = "give the rig file written by rig diagnose or rig calibrate (rig versions lists them)"
            raise FileError(name, "has no calibration, so the arm is unknown", remedy, code="calibration.missing")
    set_up = {key: getattr(rig.robot, key) for key in ("tool", "base", "payload_kg")}
    then = then.model_copy(update={"robot": then.robot.model_copy(update=set_up)})
    is_another = (then.robot.name, then.robot.serial) != (rig.robot.name, rig.robot.serial)
    return ChangedArm(then, rig, since.name, is_another_arm=is_another)


def _is_same_type(one: Rig, other: Rig) -> bool:
    arms = [arm_of(rig.robot) for rig in (one, other)]
    if arms[0].axes != arms[1].axes:
        return False
    lengths, angles = (
        np.stack([[getattr(arm, key) for key in keys] for arm in arms]) for keys in (("a", "d"), ("alpha",))
    )
    return bool(np.ptp(lengths, axis=0).max() < _SAME_TYPE_MM and np.ptp(angles, axis=0).max() < _SAME_TYPE_RAD)


def _is_rig_file(path: Path) -> bool:
    if path.suffix.lower() not in (".yaml", ".yml"):
        return False
    try:
        return bool(re.search(r"^robot:", path.read_text(encoding="utf-8", errors="replace"), re.MULTILINE))
    except OSError as error:
        raise FileError.of_os(path, error, "check the path and the permissions", code="file.unreadable") from None
