"""List of all conventions checked at import, at the end of a recording and before every diagnosis."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any
from weakref import finalize

from analysis.procedures.checks.commanded_angles import COMMANDS, command_errors, command_findings
from analysis.procedures.checks.gauge_display import DISPLAY, display_findings
from analysis.procedures.checks.gauge_sign import ORDER, SIGN, repeat_findings, sign_findings
from analysis.procedures.checks.lost_poses import DUPLICATES, WILDNESS
from analysis.procedures.checks.meanings import JOINTS, joint_findings
from analysis.procedures.checks.place import PLACE, SOURCE, STAMPS, STANDS, stand_findings
from analysis.procedures.checks.units import UNITS, unit_findings, unsigned_findings
from analysis.procedures.facts import labels_of, shows_joints
from analysis.procedures.shared.finding import Convention, Finding
from analysis.procedures.shared.test_kind import findings_against, kind_of
from analysis.runs.loading import Measured
from analysis.runs.table_format import format_of
from rigs.errors import FileError

Runs = Sequence[Measured]
_Find = Callable[[Measured], Iterable[Finding]]


@dataclass(frozen=True)
class Checked:
    """A checked convention: the findings, and the reason why the runs do not show it, empty if they do."""

    convention: Convention
    findings: tuple[Finding, ...]
    cannot: str

    def to_dict(self) -> dict[str, Any]:
        """Plain types, as listed by `rig check --json`."""
        return {
            "name": self.convention.name,
            "asks": self.convention.asks,
            "cannot": self.cannot or None,
            "findings": [finding.to_dict() for finding in self.findings],
        }


def check_runs(runs: Runs) -> list[Checked]:
    """Check runs of a robot against every convention, singly and together."""
    findings, with_joints = findings_of(runs), _with_joints(runs)
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
    with_joints, paths = _with_joints(runs), [run for run in runs if not shows_joints(run.table.test)]
    findings = [finding for find in _OF_LABELS for run in with_joints for finding in _found(find, run)]
    findings += _of_gauges(with_joints)
    findings += [finding for find in _OF_ROWS for run in with_joints for finding in _found(find, run)]
    return [*findings, *(finding for find in _OF_PATHS for run in paths for finding in _found(find, run))]


def _with_joints(runs: Runs) -> list[Measured]:
    return [run for run in runs if shows_joints(run.table.test)]


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


_KEPT: dict[int, dict[_Find, tuple[Finding, ...]]] = {}
"""Findings by the identity of the run, while it exists: a diagnosis checks a run that was checked when loaded."""


def _found(find: _Find, run: Measured) -> tuple[Finding, ...]:
    if id(run) not in _KEPT:
        _KEPT[id(run)] = {}
        finalize(run, _KEPT.pop, id(run), None)
    kept = _KEPT[id(run)]
    if find not in kept:
        kept[find] = tuple(replace(finding, runs=(run.run.manifest.name,)) for finding in find(run))
    return kept[find]


def _against(convention: str, run: Measured) -> Iterable[Finding]:
    """Findings about a convention that applies only to some kinds of test."""
    return findings_against(convention, run.table, run.rig)


def _of_joints(run: Measured) -> Iterator[Finding]:
    """Findings about the joints of a run, except after an import map, which has already compared the poses
    with the arm.
    """
    source = run.run.manifest.table
    mapped = source is not None and bool(source.map)
    return (finding for finding in joint_findings(run.table, run.rig) if not (mapped and finding.strength == "likely"))


def _of_gauges(runs: Runs) -> list[Finding]:
    """Most certain finding of each run about order and sign of the gauges. The evidence comes from repeated runs, from
    changes that no joint causes, and from the position of the ball.
    """
    every: list[Finding] = []
    for find in (repeat_findings, sign_findings, lambda runs: [one for run in runs for one in _found(_ORDER, run)]):
        named = {name for finding in every for name in finding.runs}
        every += find([run for run in runs if run.run.manifest.name not in named])
    return every


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
_ORDER = partial(_against, ORDER)
_OF_PATHS: tuple[_Find, ...] = tuple(partial(_against, convention) for convention in _SHOWN_BY_PATHS)
_OF_LABELS: tuple[_Find, ...] = (
    lambda run: unit_findings(run.table, run.rig),
    lambda run: unsigned_findings(run.table, run.rig),
    display_findings,
    _of_joints,
)
_OF_ROWS: tuple[_Find, ...] = (
    # Positions of a simulated arm are computed on purpose.
    lambda run: () if run.is_simulated else findings_against(SOURCE, run.table, run.rig),
    partial(_against, STAMPS),
    partial(_against, PLACE),
    stand_findings,
    command_findings,
    *_OF_PATHS,
)
"""Functions that search a run for findings, before and after those about order and sign of the gauges."""


def why_no_measurement(run: Measured) -> str:
    """Reason why a new run is not a valid measurement of the labelled test; empty if it is valid."""
    return next((finding.words for finding in findings_of([run]) if finding.strength != "likely"), "")
