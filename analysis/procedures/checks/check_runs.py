"""All conventions checked at import, at the end of a recording and before every diagnosis.

A difference between commanded and measured angles comes from a compliant drive or a controller without integral action
if it is correlated with the gravity torque, and is a following error if it is correlated with the speed. rig uses the
measured angles.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from analysis.procedures.checks.columns import JOINTS, joint_findings
from analysis.procedures.checks.gauge_display import DISPLAY, display_findings
from analysis.procedures.checks.gauges import ORDER, SIGN, repeat_findings, sign_findings
from analysis.procedures.checks.places import (
    DUPLICATES,
    PLACE,
    SOURCE,
    STAMPS,
    STANDS,
    TWO_PLACINGS,
    WILDNESS,
    stand_findings,
)
from analysis.procedures.checks.units import UNITS, unit_findings, unsigned_findings
from analysis.procedures.shared.test_kind import Finding, findings_against, kind_of, labels_of, shows_joints
from analysis.robot.kinematics.arm import Array, arm_of
from analysis.robot.predict import load_of, pull
from analysis.runs.loading import Measured
from analysis.runs.tables import CircleTable, Rows, format_of, joint_columns
from rigs.errors import FileError

COMMANDS = "commands"
_LEAST_DEG = 0.01
"""Smallest reported rms difference. A joint error below it moves a tool at one metre by less than 0.2 mm."""
_FEWEST = 6
"""Minimum number of rows for a correlation."""


@dataclass(frozen=True)
class CommandError:
    """Measured minus commanded angle of an axis in degrees, and its correlation with the gravity torque and with the
    speed, None if these hardly change.
    """

    axis: int
    mean_deg: float
    rms_deg: float
    with_load: float | None
    with_speed: float | None

    @property
    def words(self) -> str:
        reasons = [("load", self.with_load), ("speed", self.with_speed)]
        known = [f"{name} {value:+z.2f}" for name, value in reasons if value is not None]
        correlation = f", correlation with {', with '.join(known)}" if known else ""
        return f"axis {self.axis} mean {self.mean_deg:+z.4f}°, rms {self.rms_deg:.4f}°{correlation}"


def command_errors(run: Measured) -> tuple[CommandError, ...]:
    source = run.run.table
    both = None if source is None else _both_angles(Rows(source))
    if both is None:
        return ()
    measured, commanded = both
    off = np.degrees(measured - commanded)
    axes = off.shape[1]
    load = (
        pull(arm_of(run.rig.robot), load_of(run.rig.robot), measured).torque
        if axes == len(run.rig.robot.axes)
        else None
    )
    t_s = run.table.t_s if isinstance(run.table, CircleTable) else None
    speed = None if t_s is None else np.gradient(measured, t_s, axis=0)
    return tuple(
        CommandError(
            axis=k + 1,
            mean_deg=float(off[:, k].mean()),
            rms_deg=float(np.sqrt((off[:, k] ** 2).mean())),
            with_load=None if load is None else _correlation(off[:, k], load[:, k]),
            with_speed=None if speed is None else _correlation(off[:, k], speed[:, k]),
        )
        for k in range(axes)
    )


def command_findings(run: Measured) -> Iterator[Finding]:
    large = [error for error in command_errors(run) if error.rms_deg > _LEAST_DEG]
    if not large:
        return
    source = run.run.table
    which = "commanded" if source is not None and "q1_measured_deg" in source.column_names else "measured"
    fact = f"measured minus commanded angles: {'; '.join(error.words for error in large)}; the {which} angles are used"
    remedy = "a difference that varies with load or speed comes from the drives, not from the geometry of the arm"
    columns = tuple(f"q{error.axis}_deg" for error in large)
    yield Finding(COMMANDS, "likely", columns, "angles that were not reached", fact, remedy)


def _both_angles(rows: Rows) -> tuple[Array, Array] | None:
    """Measured and commanded angles (n, axes) rad; None if one of them is missing."""
    axes = range(1, rows.axes + 1)
    for other, is_measured in (("measured", True), ("commanded", False)):
        names = tuple(f"q{axis}_{other}_deg" for axis in axes)
        if not rows.has(names):
            continue
        try:
            angles = np.radians(np.array([rows.columns[name].to_pylist() for name in names], dtype=float).T)
        except ValueError:  # a column of text
            return None
        used = rows.values(joint_columns(rows.axes))
        return (angles, used) if is_measured else (used, angles)
    return None


def _correlation(off: Array, cause: Array) -> float | None:
    if len(off) < _FEWEST or np.ptp(off) < 1e-9 or np.ptp(cause) < 1e-9:
        return None
    return float(np.corrcoef(off, cause)[0, 1])


Runs = Sequence[Measured]
Find = Callable[[Measured], Iterable[Finding]]


@dataclass(frozen=True)
class Convention:
    """A convention checked against data. cannot: reason why these runs cannot show it, empty if they can."""

    name: str
    asks: str
    cannot: Callable[[Runs], str]


@dataclass(frozen=True)
class Checked:
    """A checked convention: the findings, and the reason why the runs do not show it, empty if they do."""

    convention: Convention
    findings: tuple[Finding, ...]
    cannot: str

    def to_dict(self) -> dict[str, Any]:
        return {
            "name": self.convention.name,
            "asks": self.convention.asks,
            "cannot": self.cannot or None,
            "findings": [finding.to_dict() for finding in self.findings],
        }


def check_runs(runs: Runs) -> list[Checked]:
    findings, with_joints = findings_of(runs), [run for run in runs if shows_joints(run.table.test)]

    def cannot(convention: Convention) -> str:
        if with_joints:
            return convention.cannot(with_joints)
        why = f"the table {labels_of(runs[0].table.test).unsupported_reason}"
        return "" if convention.name in _SHOWN_BY_PATHS else why

    return [
        Checked(
            convention,
            tuple(finding for finding in findings if finding.convention == convention.name),
            cannot(convention),
        )
        for convention in CONVENTIONS
    ]


def findings_of(runs: Runs) -> list[Finding]:
    """Findings against conventions in runs of a robot. Path recordings are checked by their positions only."""
    with_joints = [run for run in runs if shows_joints(run.table.test)]
    findings = [finding for run in with_joints for finding in _found("columns", run)]
    # The most certain finding of each run about order and sign of the gauges: from repeated runs, from changes that no
    # joint causes, or from the position of the ball.
    about_gauges: list[Finding] = []
    for find_in in (
        repeat_findings,
        sign_findings,
        lambda those: [one for run in those for one in _found("order", run)],
    ):
        named = {name for finding in about_gauges for name in finding.runs}
        about_gauges += find_in([run for run in with_joints if run.run.manifest.name not in named])
    findings += about_gauges
    for run in runs:
        groups = ("rows", "places") if shows_joints(run.table.test) else ("places",)
        findings += [finding for group in groups for finding in _found(group, run)]
    # With joints that mean something else, the arm fits parts of the rows better than all of them.
    misread = {name for finding in findings if finding.convention == JOINTS for name in finding.runs}
    return [finding for finding in findings if finding.meant != TWO_PLACINGS or not misread & set(finding.runs)]


def doubts_of(run: Measured, *, with_refusals: bool = True) -> tuple[str, ...]:
    """Doubts about a run: those already known, then the findings against conventions.

    with_refusals: include the findings for which a diagnosis refuses or ignores the run, which it reports itself.
    """
    findings = findings_of([run])
    refusals = () if with_refusals else [finding.words for finding in findings if finding.strength != "likely"]
    every = dict.fromkeys((*run.doubts, *(finding.words for finding in findings)))
    return tuple(doubt for doubt in every if doubt not in refusals)


def why_no_measurement(run: Measured) -> str:
    return next((finding.words for finding in findings_of([run]) if finding.strength != "likely"), "")


def refuse_impossible(run: Measured, where: str) -> None:
    """Raise FileError for the first finding that is impossible for a run with this label."""
    if not shows_joints(run.table.test):
        return
    for findings in (unit_findings(run.table, run.rig), findings_against(SOURCE, run.table, run.rig)):
        wrong = [finding for finding in findings if finding.strength == "impossible"]
        if wrong:
            problems, remedies = ([getattr(finding, of) for finding in wrong] for of in ("what", "remedy"))
            raise FileError(where, "; ".join(problems), ", and ".join(dict.fromkeys(remedies)), code="run.damaged")


def _found(about: str, run: Measured) -> tuple[Finding, ...]:
    # They are kept with the run: a diagnosis checks a run that was checked when loaded.
    kept: dict[str, tuple[Finding, ...]] = vars(run).setdefault("_findings", {})
    if about not in kept:
        name = run.run.manifest.name
        kept[about] = tuple(replace(finding, runs=(name,)) for find in _FINDERS[about] for finding in find(run))
    return kept[about]


def _against(convention: str) -> Find:
    return lambda run: findings_against(convention, run.table, run.rig)


def _of_joints(run: Measured) -> Iterator[Finding]:
    # An import map has already compared the poses with the arm.
    source = run.run.manifest.table
    mapped = source is not None and bool(source.map)
    findings = joint_findings(run.table, run.rig)
    yield from (finding for finding in findings if not (mapped and finding.strength == "likely"))


def _of_source(run: Measured) -> Iterable[Finding]:
    # positions of a simulated arm are computed on purpose
    return () if run.is_simulated else findings_against(SOURCE, run.table, run.rig)


_SHOWN_BY_PATHS = (WILDNESS, DUPLICATES)
"""Conventions that a recording of positions alone can contradict."""
_FINDERS: dict[str, tuple[Find, ...]] = {
    "columns": (
        lambda run: unit_findings(run.table, run.rig),
        lambda run: unsigned_findings(run.table, run.rig),
        display_findings,
        _of_joints,
    ),
    "order": (_against(ORDER),),
    "rows": (
        _of_source,
        *(_against(convention) for convention in (STAMPS, PLACE)),
        stand_findings,
        command_findings,
    ),
    "places": tuple(_against(convention) for convention in _SHOWN_BY_PATHS),
}
"""Functions that check one run: the columns, the order of the gauges and the rows of a run with joints, and the
positions of any run.
"""


def _joints_hidden(runs: Runs) -> str:
    why = [kind_of(run.table.test).cannot_tell(run.table, run.rig) for run in runs]
    return "" if "" in why else next(iter(why), "")


def _needs(convention: str, why: str) -> Callable[[Runs], str]:
    return lambda runs: "" if any(convention in kind_of(run.table.test).finders for run in runs) else why


def _no_pair(runs: Runs) -> str:
    ways = {(run.run.manifest.test, run.run.manifest.direction) for run in runs}
    both = any((test, "cw") in ways for test, way in ways if way == "acw")
    if both or any(run.rig.effects or run.rig.calibrated for run in runs if format_of(run.table.test).gauges):
        return ""
    return "it needs circles in both directions and a joint with play, or an effect in the rig file"


def _no_stops(runs: Runs) -> str:
    imported = any(run.run.table is not None and not run.table.swept for run in runs)
    return "" if imported else "the runs contain no imported targets or poses"


def _no_commands(runs: Runs) -> str:
    return "" if any(map(command_errors, runs)) else "the runs do not contain both commanded and measured angles"


_CIRCLE, _POSES = _needs(STAMPS, "the runs contain no circle"), _needs(SOURCE, "the runs contain no poses")
CONVENTIONS = (
    Convention(UNITS, "mm and degrees, or µm, inches, metres, radians", lambda _: ""),
    Convention(JOINTS, "do order, signs, zeros and coupling of the joints fit", _joints_hidden),
    Convention(ORDER, "are g1 and g2 exchanged", _CIRCLE),
    Convention(SIGN, "do the readings grow with the distance from the ball", _no_pair),
    Convention(DISPLAY, "does each gauge show what it measures, with sign and range", _CIRCLE),
    Convention(SOURCE, "did an instrument measure the places", _POSES),
    Convention(STAMPS, "is t_s in seconds, by the speed of the circle", _CIRCLE),
    Convention(
        PLACE, "was each target at the place given in the rig file", _needs(PLACE, "the runs contain no targets")
    ),
    Convention(STANDS, "is each row a separate visit", _no_stops),
    Convention(COMMANDS, "were the commanded angles reached", _no_commands),
    Convention(WILDNESS, "did the tracker see the target", _POSES),
    Convention(DUPLICATES, "is a place or a row repeated", _POSES),
)
"""All conventions, in reading order."""
