"""List of all conventions checked at import, at the end of a recording and before every diagnosis.

Among them: a difference between commanded and measured angles correlated with the gravity torque comes from a compliant
drive or a controller without integral action, and one correlated with the speed is a following error. rig uses the
measured angles.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from analysis.procedures.checks.gauge_display import DISPLAY, display_findings
from analysis.procedures.checks.gauge_sign import ORDER, SIGN, repeat_findings, sign_findings
from analysis.procedures.checks.lost_poses import DUPLICATES, WILDNESS
from analysis.procedures.checks.meanings import JOINTS, joint_findings
from analysis.procedures.checks.place import PLACE, SOURCE, STAMPS, STANDS, stand_findings
from analysis.procedures.checks.units import UNITS, unit_findings, unsigned_findings
from analysis.procedures.facts import labels_of, shows_joints
from analysis.procedures.shared.finding import Convention, Finding
from analysis.procedures.shared.test_kind import findings_against, kind_of
from analysis.robot.kinematics.arm import Array, arm_of
from analysis.robot.model.scene import load_of, pull
from analysis.runs.loading import Measured
from analysis.runs.table_format import Rows, format_of
from rigs.errors import FileError

COMMANDS = "commands"
_LEAST_DEG = 0.01
"""Smallest reported rms difference. A joint error below it moves a tool at one metre by less than 0.2 mm."""
_FEWEST = 6
"""Minimum number of rows for a correlation."""


@dataclass(frozen=True)
class CommandError:
    """Following error of an axis: measured minus commanded angle in degrees, and its correlation with the gravity
    torque and with the speed. A correlation is None if the torque or speed hardly changes.
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
    """Following error of each axis; empty if the run lacks commanded or measured angles."""
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
    t_s = Rows(source).times() if source is not None and run.table.swept else None
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
    """A finding for the axes with a considerable following error."""
    large = [error for error in command_errors(run) if error.rms_deg > _LEAST_DEG]
    if not large:
        return
    which = "commanded" if _has_column(run, "q1_measured_deg") else "measured"
    fact = f"measured minus commanded angles: {'; '.join(error.words for error in large)}; the {which} angles are used"
    remedy = "a difference that varies with load or speed comes from the drives, not from the geometry of the arm"
    columns = tuple(f"q{error.axis}_deg" for error in large)
    yield Finding(COMMANDS, "likely", columns, "angles that were not reached", fact, remedy)


def _has_column(run: Measured, name: str) -> bool:
    return run.run.table is not None and name in run.run.table.column_names


def _both_angles(rows: Rows) -> tuple[Array, Array] | None:
    """Measured and commanded angles (n, axes) rad of a table; None if one of them is missing."""
    axes = range(1, rows.axes + 1)
    for other, is_measured in (("measured", True), ("commanded", False)):
        names = tuple(f"q{axis}_{other}_deg" for axis in axes)
        if not rows.has(names):
            continue
        try:
            angles = np.radians(np.array([rows.columns[name].to_pylist() for name in names], dtype=float).T)
        except ValueError:  # a column of text
            return None
        return (angles, rows.q) if is_measured else (rows.q, angles)
    return None


def _correlation(off: Array, cause: Array) -> float | None:
    if len(off) < _FEWEST or np.ptp(off) < 1e-9 or np.ptp(cause) < 1e-9:
        return None
    return float(np.corrcoef(off, cause)[0, 1])


Runs = Sequence[Measured]
_Find = Callable[[Measured], Iterable[Finding]]


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
    return [
        Checked(
            convention,
            tuple(finding for finding in findings if finding.convention == convention.name),
            convention.cannot(with_joints)
            if with_joints
            else ""
            if convention.name in _SHOWN_BY_PATHS
            else f"the table {labels_of(runs[0].table.test).unsupported_reason}",
        )
        for convention in CONVENTIONS
    ]


def findings_of(runs: Runs) -> list[Finding]:
    """Findings against conventions in runs of a robot. For path recordings, which contain neither joints nor gauges,
    only positions are checked.
    """
    with_joints = [run for run in runs if shows_joints(run.table.test)]
    findings = [finding for run in with_joints for finding in _found(_about_columns, run)]
    # The most certain finding of each run about order and sign of the gauges: from repeated runs, from changes that no
    # joint causes, or from the position of the ball.
    about_gauges: list[Finding] = []
    for find in (repeat_findings, sign_findings, _about_order):
        named = {name for finding in about_gauges for name in finding.runs}
        about_gauges += find([run for run in with_joints if run.run.manifest.name not in named])
    findings += about_gauges
    for run in runs:
        findings += _found(_about_rows if shows_joints(run.table.test) else _about_places, run)
    return findings


def doubts_of(run: Measured, *, with_refusals: bool = True) -> tuple[str, ...]:
    """Doubts about a single run as text: those already known, then the findings against conventions.

    with_refusals: include the findings for which a diagnosis refuses or ignores the run, which it reports itself.
    """
    findings = findings_of([run])
    refusals = () if with_refusals else [finding.words for finding in findings if finding.strength != "likely"]
    every = dict.fromkeys((*run.doubts, *(finding.words for finding in findings)))
    return tuple(doubt for doubt in every if doubt not in refusals)


def refuse_impossible(run: Measured, where: str) -> None:
    """Raise FileError for the first finding that is impossible for a run with this label."""
    if not shows_joints(run.table.test):
        return
    for findings in (unit_findings(run.table, run.rig), findings_against(SOURCE, run.table, run.rig)):
        wrong = [finding for finding in findings if finding.strength == "impossible"]
        if wrong:
            problems, remedies = ([getattr(finding, of) for finding in wrong] for of in ("what", "remedy"))
            raise FileError(where, "; ".join(problems), ", and ".join(dict.fromkeys(remedies)), code="run.impossible")


def _found(find: _Find, run: Measured) -> tuple[Finding, ...]:
    # They are kept with the run: a diagnosis checks a run that was checked when loaded.
    kept: dict[_Find, tuple[Finding, ...]] = vars(run).setdefault("_findings", {})
    if find not in kept:
        kept[find] = tuple(replace(finding, runs=(run.run.manifest.name,)) for finding in find(run))
    return kept[find]


def _about_columns(run: Measured) -> Iterator[Finding]:
    yield from unit_findings(run.table, run.rig)
    yield from unsigned_findings(run.table, run.rig)
    yield from display_findings(run)
    # An import map has already compared the poses with the arm.
    source = run.run.manifest.table
    mapped = source is not None and bool(source.map)
    joints = joint_findings(run.table, run.rig)
    yield from (finding for finding in joints if not (mapped and finding.strength == "likely"))


def _about_order(runs: Runs) -> list[Finding]:
    return [finding for run in runs for finding in _found(_about_order_of_gauges, run)]


def _about_order_of_gauges(run: Measured) -> Iterable[Finding]:
    return findings_against(ORDER, run.table, run.rig)


def _about_rows(run: Measured) -> Iterator[Finding]:
    if not run.is_simulated:  # positions of a simulated arm are computed on purpose
        yield from findings_against(SOURCE, run.table, run.rig)
    yield from findings_against(STAMPS, run.table, run.rig)
    yield from findings_against(PLACE, run.table, run.rig)
    yield from stand_findings(run)
    yield from command_findings(run)
    yield from _about_places(run)


def _about_places(run: Measured) -> Iterator[Finding]:
    for convention in _SHOWN_BY_PATHS:
        yield from findings_against(convention, run.table, run.rig)


def _joints_hidden(runs: Runs) -> str:
    why = [kind_of(run.table.test).cannot_tell(run.table, run.rig) for run in runs]
    return "" if "" in why else next(iter(why), "")


def _without(convention: str, why: str) -> Callable[[Runs], str]:
    """A function that gives the reason why no run of a suitable kind is available for a convention."""
    return lambda runs: "" if any(convention in dict(kind_of(run.table.test).finders) for run in runs) else why


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


_no_yaw = _without(STAMPS, "the runs contain no circle")
_no_poses = _without(SOURCE, "the runs contain no poses")
_no_targets = _without(PLACE, "the runs contain no targets")
CONVENTIONS = (
    Convention(UNITS, "mm and degrees, or µm, inches, metres, radians", lambda _: ""),
    Convention(JOINTS, "do order, signs, zeros and coupling of the joints fit", _joints_hidden),
    Convention(ORDER, "are g1 and g2 exchanged", _no_yaw),
    Convention(SIGN, "do the readings grow with the distance from the ball", _no_pair),
    Convention(DISPLAY, "does each gauge show what it measures, with sign and range", _no_yaw),
    Convention(SOURCE, "did an instrument measure the places", _no_poses),
    Convention(STAMPS, "is t_s in seconds, by the speed of the circle", _no_yaw),
    Convention(PLACE, "was each target at the place given in the rig file", _no_targets),
    Convention(STANDS, "is each row a separate visit", _no_stops),
    Convention(COMMANDS, "were the commanded angles reached", _no_commands),
    Convention(WILDNESS, "did the tracker see the target", _no_poses),
    Convention(DUPLICATES, "is a place or a row repeated", _no_poses),
)
"""All conventions, in reading order."""

_SHOWN_BY_PATHS = (WILDNESS, DUPLICATES)


def why_no_measurement(run: Measured) -> str:
    return next((finding.words for finding in findings_of([run]) if finding.strength != "likely"), "")
