"""First sentence and first act of fresh cells, scored by doing in a stranger's simulator what the first act says.

`scripts/dev acts 60 --seed 1` makes cells on circles, of poses and of touches by generators that share no code with rig
(one to three faults, sound, few runs, outside the library), diagnoses them by their runs with another place that only
judges, does the first act, and compares the error there before and after with what the act stated. `--kinds none one
outside` takes these kinds in turn; the second table counts names, their sizes, and what every act serves.
"""

from __future__ import annotations

import json
import math
import sys
import tempfile
import time
from argparse import Namespace
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np

from analysis.apps.report.answer_words import large_parts
from analysis.apps.report.summary_words import summarise
from analysis.diagnosis.diagnose import diagnose
from analysis.diagnosis.evidence.observation import ObservedRun, by_socket, observe_run
from analysis.diagnosis.evidence.setups import FittedRuns
from analysis.diagnosis.judge.acts import Act
from analysis.diagnosis.judge.result import Diagnosis, Named
from analysis.diagnosis.judge.validation import residual_um
from analysis.robot.kinematics.arm import Array
from analysis.robot.model.predict import model_of
from analysis.runs.loading import Measured, load_measured
from analysis.runs.tables import CircleTable, PoseTable, TouchTable
from rigs.arms import load_arm
from rigs.effects import Effect
from rigs.load import load, parse
from rigs.rig import Rig
from rigs.schema.effect import name_of, size_field
from tests.support import rates
from tests.support.trial import Trial, main, seeds
from tests.trials.blind.trial import Job, make_case, runs_of
from tests.worlds.arms import seven_axes
from tests.worlds.stranger import cases
from tests.worlds.stranger.faults import Fault

KINDS = ("one", "two", "three", "none", "few", "outside")
"""As in the blind trial; `few` is two faults by a lap each way, or by a fourth of the poses or touches."""
WAYS = ("circles", "poses", "touches")
ARMS = ("ur10e", "franka-fr3", "doosan-m1013", "kuka-lbr-iiwa-14")
"""Arms of the library that are measured by poses and touches, in turn."""
BALL_MM = np.array([10.0, -5.0, 120.0])
POSES, TOUCHES, SOCKETS, FEWER = 100, 80, 2, 4
_FAULTS = {"one": 1, "two": 2, "three": 3, "few": 2}
_STRANGE = ("slip", "cross", "drag")
"""What no library has: a joint's link is off beyond one angle, errs with the sum of its angle and another's, or leans
to the side from which another joint came."""
_TIMES_ALL_ELSE = (1.2, 3.0)
"""Size of the hidden error relative to all other errors of the arm."""
_TAKEN_AWAY = 0.8
"""Share of the energy that a fault makes from which an act has taken it away."""
_PROBE_RAD = 0.002
_GROUPS = {
    "joint_offset": "constants", "link_geometry": "constants", "compliance": "gravity", "backlash": "reversal",
}  # fmt: skip
"""The group of small terms to which each kind of fault belongs."""
_BY_NAME = ("first", "act", "part", "rival", "member")
"""Ways in which an act serves a fault by its name."""
_SEATS = ("axis", "field", "gauge", "from_axis", "to_axis", "other")
_DONE = ("repair", "mount", "remaster", "enter", "load")
"""Acts that change the arm or what is sent to it."""


@dataclass(frozen=True)
class Cell:
    """A cell: its runs, those of another place, and the error there (µm) of the stranger's arm without the cause of a
    name, beside effects that are entered. `hidden` has the names that count as each of what is hidden, the one that
    makes most first; `makes_um` is what that makes, and `sizes` what the arm really has of each, by name; `strange` is
    the part of the budget that says what no library has, where there is one."""

    rig: Rig
    used: Sequence[Measured]
    unseen: Sequence[Measured]
    error_um: Callable[[str | None, Sequence[Effect]], float]
    hidden: Sequence[frozenset[str]]
    makes_um: float = math.nan
    sizes: Mapping[str, float] = field(default_factory=dict)
    strange: str = ""


@dataclass(frozen=True)
class Sized:
    """A confirmed effect: its name, and the error of its size in standard uncertainties."""

    name: str
    error_over_u: float


@dataclass(frozen=True)
class Scored:
    """A cell: its kind, way and seed, the first sentence, the first act with what it stated and what came (µm at the
    other place), and whether the first sentence has what makes most."""

    kind: str
    way: str
    seed: int
    headline: str
    act: Act
    before_um: float
    after_um: float
    is_named: bool | None
    seconds: float
    condition: str = ""
    makes_um: float = math.nan
    served: tuple[str, ...] = ()
    """How an act serves each hidden effect: `first` and `act` by itself, `part` or `rival` of what an act serves,
    `member` of a group that names its likeliest, `test` that would name it, `group` of constants, softness or
    reversals, or `none`."""
    vain: tuple[str, ...] = ()
    sized: tuple[Sized, ...] = ()
    is_strange_said: bool | None = None

    @property
    def is_right(self) -> bool:
        """True if the first action addresses the largest cause, or removes most of its error."""
        taken = self.before_um**2 - self.after_um**2
        return self.served[:1] == ("first",) or taken >= _TAKEN_AWAY * self.makes_um**2

    @property
    def fell_as_stated(self) -> bool | None:
        """Whether the error is what the act stated within 2 u; None of acts that state nothing."""
        if self.act.kind not in _DONE or self.act.removes_um is None:
            return None
        return abs(self.after_um - self.act.residual_um) <= 2 * (self.act.remains_u_um or 0.0)

    @property
    def is_larger(self) -> bool:
        """Whether the act made the error larger, by more than a twentieth."""
        return self.after_um > 1.05 * self.before_um

    def __str__(self) -> str:
        act = self.act
        figures = f"{act.gain_um + act.residual_um:.1f} to {act.residual_um:.1f} ± {act.remains_u_um or 0.0:.1f}"
        stated = "nothing" if act.removes_um is None else figures
        verdict = {True: "as stated", False: "NOT as stated", None: "states nothing"}[self.fell_as_stated]
        named = {True: "named", False: "NOT NAMED", None: "-"}[self.is_named]
        return (
            f"{self.kind:8s}{self.way:8s}{self.seed:4d}  {self.seconds:5.1f} s {act.kind:9s}{act.why:15s} stated "
            f"{stated}, came {self.before_um:.1f} to {self.after_um:.1f}: {verdict}{' LARGER' * self.is_larger}; "
            f"{named}: {self.headline} [{self.condition}; served {self.served}; vain {self.vain}; sizes "
            f"{', '.join(f'{one.name} {one.error_over_u:+.2f}' for one in self.sized)}; strange "
            f"{self.is_strange_said}; right {self.is_right}]"
        )


def draw(given: Namespace) -> Iterator[tuple[str, str, int]]:
    """The kind and the way of each seed in turn."""
    for seed in seeds(given):
        way = given.ways[(seed + seed // len(given.kinds)) % len(given.ways)]
        yield given.kinds[seed % len(given.kinds)], way, seed


def table(done: Sequence[Scored]) -> str:
    """The counts."""
    stated = [one.fell_as_stated for one in done if one.fell_as_stated is not None]
    named = [one.is_named for one in done if one.is_named is not None]
    sent = [one for one in done if one.kind == "none" and one.act.kind in ("repair", "mount", "remaster", "enter")]
    return "\n".join([
        f"first acts that state a figure, as stated within 2 u: {sum(stated)} of {len(stated)}",
        f"acts that made the error larger: {sum(one.is_larger for one in done)} of {len(done)}",
        f"first sentences with what makes most: {sum(named)} of {len(named)}",
        f"sound cells sent to repair: {len(sent)} of {sum(one.kind == 'none' for one in done)}",
        *rates.table(rows_of(done)),
    ])  # fmt: skip


def rows_of(done: Sequence[Scored]) -> list[rates.Row]:
    """The rates of the specification, with Wilson's intervals."""
    of = {kind: [one for one in done if one.kind == kind] for kind in KINDS}
    several = [level for one in (*of["two"], *of["three"]) for level in one.served]
    cells = [one.served for one in (*of["two"], *of["three"])]
    sizes = [one for cell in done for one in cell.sized]
    names = len(sizes) + sum(len(one.vain) for one in done)
    inside = [abs(one.error_over_u) <= 2 for one in sizes]
    kinds = sorted({one.name.split()[0] for one in sizes})
    strange = [bool(one.is_strange_said) for one in of["outside"]]
    return [
        rates.counted("sound: sent to repair", 0.0, sum(map(_is_sent, of["none"])), len(of["none"]), most=True),
        rates.counted("one fault: first act right", 0.97, sum(one.is_right for one in of["one"]), len(of["one"])),
        rates.counted("two, three: all in the acts", 0.93, sum("none" not in cell for cell in cells), len(cells)),
        rates.counted("  faults by name", 0.93, sum(level in _BY_NAME for level in several), len(several)),
        rates.counted("foreign: said", 0.95, sum(strange), len(strange)),
        rates.counted("names in vain", 0.05, sum(len(one.vain) for one in done), names, most=True),
        rates.counted("sizes within 2 u", 0.92, sum(inside), len(inside)),
        *(
            rates.counted(
                f"  {kind}", 0.92, sum(abs(one.error_over_u) <= 2 for one in sizes if one.name.startswith(kind)),
                sum(one.name.startswith(kind) for one in sizes),
            )
            for kind in kinds
        ),
    ]  # fmt: skip


def _is_sent(one: Scored) -> bool:
    return one.act.kind in ("repair", "mount", "remaster", "enter")


def scored(case: tuple[str, str, int]) -> Scored:
    """A cell made, diagnosed and done as its first act says."""
    kind, way, seed = case
    with tempfile.TemporaryDirectory() as directory:
        cell = of_circles(kind, seed, Path(directory)) if way == "circles" else of_places(kind, way, seed)
        return _scored(cell, kind, way, seed)


def _scored(cell: Cell, kind: str, way: str, seed: int) -> Scored:
    begin = time.process_time()
    found = diagnose(cell.rig, cell.used, [], cell.unseen, lambda _: None)
    seconds = time.process_time() - begin
    act = found.acts[0]
    return Scored(
        kind, way, seed, summarise(found).headline, act, cell.error_um(None, []), _after(found, act, cell),
        _is_named(found, cell.hidden), seconds, found.condition, cell.makes_um,
        tuple(_served(found, names) for names in cell.hidden),
        tuple(name for name in map(_name, found.standing) if not any(name in names for names in cell.hidden)),
        tuple(_sizes(found, cell)), _is_strange_said(found, cell.strange) if kind == "outside" else None,
    )  # fmt: skip


def _name(one: Named) -> str:
    return name_of(one.effect)


def _served(found: Diagnosis, names: frozenset[str]) -> str:
    """The nearest way in which an act serves what is hidden."""
    by_act = [{name_of(act.effect)} if act.effect else set() for act in found.acts]
    parts = [found.budget[k] for act in found.acts for k in act.parts]
    effects = [found.effects[part.index] for part in parts if part.index is not None]
    levels = {
        "first": by_act[0],
        "act": set().union(*by_act),
        "part": set(map(_name, effects)),
        "rival": {name_of(rival.effect) for one in effects for rival in one.rivals},
        "member": {name_of(member.effect) for part in parts for member in part.members},
        "test": {name for act in found.acts if act.test for name in act.test.names},
    }
    groups = {part.kind for part in parts if part.index is None}
    grouped = "group" if any(_GROUPS.get(name.split()[0]) in groups for name in names) else "none"
    return next((level for level, own in levels.items() if own & names), grouped)


def _sizes(found: Diagnosis, cell: Cell) -> Iterator[Sized]:
    for one in found.standing:
        key = size_field(one.effect)
        if _name(one) in cell.sizes:
            error = getattr(one.effect, key) - cell.sizes[_name(one)]
            yield Sized(_name(one), error / one.sd.get(key, math.nan))


def _is_strange_said(found: Diagnosis, strange: str) -> bool:
    """Whether the first sentence has that something unknown is there, or what it really is."""
    return found.condition == "outside_library" or any(part.label == strange for part in large_parts(found))


def _after(found: Diagnosis, act: Act, cell: Cell) -> float:
    """The error there once the act is done: a cause that is repaired is gone, what is entered or corrected is taken off
    as the model has it."""
    if act.kind in ("repair", "mount") and act.effect is not None:
        return cell.error_um(name_of(act.effect), [])
    if act.kind in ("remaster", "enter") and act.effect is not None:
        return cell.error_um(None, [act.effect])
    if act.kind == "load" and found.calibrated is not None:
        model = [*(one.effect for one in found.written), *found.calibrated.effects]
        return cell.error_um(None, [one for one in model if one.compensation().use != "none"])
    return cell.error_um(None, [])


def _is_named(found: Diagnosis, hidden: Sequence[frozenset[str]]) -> bool | None:
    """Whether the first sentence has what is hidden and shows most, by itself or as the likeliest of a group."""
    if not hidden:
        return None
    said = {name_of(one.effect) for one in found.standing}
    for part in large_parts(found):
        if part.index is not None:
            one = found.effects[part.index]
            said |= {name_of(one.effect), *(name_of(rival.effect) for rival in one.rivals)}
        said |= {name_of(one.effect) for one in part.members}
    return bool(said & hidden[0])


# ----------------------------------------------------------------------------------------------------------------------
# Circles: the stranger's blind cases, with another place of the ball.


def of_circles(kind: str, seed: int, directory: Path) -> Cell:
    """A cell of circles of `tests.worlds.stranger`."""
    job = Job("two" if kind == "few" else kind, seed, directory, "quiet", "tolerance")
    make_case(job)
    truth = json.loads(job.truth.read_text(encoding="utf-8"))
    places = runs_of(job.case)
    used = [load_measured(path) for path in places["train"]]
    if kind == "few":
        yaw = [run for run in used if run.run.manifest.test == "yaw"]
        used = list({run.run.manifest.direction: run for run in yaw}.values())
    unseen = [load_measured(path) for path in places["unseen"]]
    every = _faults(truth)

    def error_um(repaired: str | None, entered: Sequence[Effect]) -> float:
        driven = _driven(truth, job.case, [fault for fault in every if fault.name != repaired])
        return residual_um(driven, FittedRuns(driven), entered)

    whole = error_um(None, [])
    makes = {one["name"]: whole**2 - error_um(one["name"], []) ** 2 for one in truth["hidden"]}
    hidden = sorted(truth["hidden"], key=lambda one: -float(one["snr"]))
    return Cell(
        used[0].rig, used, unseen, error_um, [frozenset(one["class"]) for one in hidden],
        math.sqrt(max([0.0, *makes.values()])), {one["name"]: float(one["parameters"][one["size"]]) for one in hidden},
    )  # fmt: skip


def _faults(truth: Mapping[str, Any]) -> list[Any]:
    found = [cases.fault_from(one) for one in (*truth["hidden"], *truth["background"])]
    if foreign := truth["outside"]:
        keys = {key: foreign[key] for key in _SEATS if key in foreign}
        shape = {key: value for key, value in foreign["parameters"].items() if key != "size"}
        form = foreign["form"]
        size = float(foreign["parameters"]["size"])
        found.append(Fault(foreign["effect"], keys, size, shape, form["rough"], form["begin"]))
    return found


def _driven(truth: Mapping[str, Any], case: Path, faults: Sequence[Any]) -> list[ObservedRun]:
    """What gauges read at the other place without noise, by the stranger's arm with these faults."""
    # private _begun, _Run: the same session as the case, driven at another place
    session, _ = cases._begun(truth["kind"], truth["seed"], truth["scale"])
    model, link, runs = model_of(load(str(case / "unseen.yaml"))[0]), session.links["unseen"], []
    for lap in session.laps("unseen", list(faults)):
        run = cases._Run("yaw", lap.direction, "unseen")
        plain = cases.measure(session.unseen[0], session.motion(run, np.random.default_rng(0)), [], link)
        table = CircleTable("yaw", lap.direction, lap.t_s, lap.q, plain + lap.added)  # type: ignore[arg-type]
        runs.append(observe_run(model, table, f"yaw {lap.direction}"))
    return runs


# ----------------------------------------------------------------------------------------------------------------------
# Poses and touches: arms of `tests.worlds.arms.seven_axes`, with a tracker in another place, or sockets elsewhere.


def of_places(kind: str, way: str, seed: int) -> Cell:
    """A cell of poses before a tracker, or of touches of two sockets."""
    rng = np.random.default_rng([52, seed])
    letters = ", ".join(f'"{letter}"' for letter in "ABCD"[:SOCKETS])
    arm = load_arm(ARMS[seed % len(ARMS)])
    rig = parse(f"name: cell\n{arm.text}tests: {{touch: {{sockets: [{letters}]}}}}\n", "cell.yaml")
    faults = seven_axes.draw_faults(rig.robot, rng, _FAULTS.get(kind, 0))
    strange: Strange | None = None
    if kind == "outside":
        joints = rng.choice(range(1, len(rig.robot.axes) - 1), 2, replace=False)
        joint, other = map(int, joints)
        middle = float(np.mean(np.radians(rig.robot.axes[joint].limits_deg)))  # beyond the least angle it is a zero
        at = middle + float(rng.uniform(-0.3, 0.3))
        strange = Strange(_STRANGE[seed // 2 % 3], joint, other, at, _PROBE_RAD)

    def arm_with(rest: Sequence[seven_axes.Fault], seen: Strange | None) -> seven_axes.Truth:
        drawn = seven_axes.draw_truth(rig.robot, np.random.default_rng([53, seed]), tuple(rest))
        return StrangeArm(**vars(drawn), strange=seen)

    fewer = FEWER if kind == "few" else 1
    measured = partial(_measured, rig, way)

    def error_um(
        repaired: str | None, entered: Sequence[Effect], by: Strange | Literal["as it is"] | None = "as it is"
    ) -> float:
        rest = [fault for fault in faults if fault.name != repaired]
        still = replace(arm_with(rest, strange if by == "as it is" else by), scatter_mm=0.0)
        there = observe_run(model_of(rig), measured(still, np.random.default_rng([55, seed]), 1), way)
        runs = by_socket(there)
        return residual_um(runs, FittedRuns(runs), entered)

    if strange:
        plain_um, probe_um = error_um(None, [], None), error_um(None, [], strange)
        share = math.sqrt(max(probe_um**2 - plain_um**2, (0.02 * plain_um) ** 2)) / plain_um
        strange = replace(strange, size=strange.size * float(rng.uniform(*_TIMES_ALL_ELSE)) / share)
    used = measured(arm_with(faults, strange), np.random.default_rng([54, seed]), fewer)
    unseen = measured(arm_with(faults, strange), np.random.default_rng([55, seed]), 1)
    whole = error_um(None, [])
    makes = {fault.name: whole**2 - error_um(fault.name, []) ** 2 for fault in faults}
    hidden = [frozenset([name]) for name in sorted(makes, key=lambda name: -makes[name])]
    runs = (seven_axes.run_of(rig, table, name, name) for table, name in ((used, "used"), (unseen, "unseen")))
    drawn = arm_with(faults, strange)
    return Cell(
        rig, [next(runs)], [next(runs)], error_um, hidden, math.sqrt(max([0.0, *makes.values()])),
        {fault.name: drawn.size_of(fault) for fault in faults},
        f"curve {strange.joint + 1}" if strange and strange.form == "slip" else "",
    )  # fmt: skip


@dataclass(frozen=True)
class Strange:
    """Something of a form in no library: of a joint from 0, with another, at an angle (rad), so large (rad)."""

    form: str
    joint: int
    other: int
    at: float
    size: float


@dataclass(frozen=True)
class StrangeArm(seven_axes.Truth):
    """An arm that has it."""

    strange: Strange | None = None

    def link_q(self, q: Array, came_from: Array) -> Array:
        """Link-side angles (n, axes) rad."""
        out = super().link_q(q, came_from)
        if one := self.strange:
            mine, other = q[:, one.joint], q[:, one.other]
            form = {
                "slip": np.where(mine > one.at, 1.0, 0.0),
                "cross": np.sin(2 * (mine + other) + one.at),
                "drag": np.sign(other - came_from[:, one.other]),
            }[one.form]
            out[:, one.joint] += one.size * form
        return out


def _measured(
    rig: Rig, way: str, truth: seven_axes.Truth, rng: np.random.Generator, fewer: int
) -> PoseTable | TouchTable:
    if way == "poses":
        return seven_axes.pose_table(rig.robot, truth, rng, BALL_MM, POSES // fewer)
    return seven_axes.touch_table(rig.robot, truth, rng, BALL_MM, SOCKETS, TOUCHES // fewer)


TRIAL = Trial(
    draw,
    scored,
    table,
    count=6,
    seed=1,
    options={
        "ways": (WAYS, "circles, poses, touches (all)", WAYS),
        "kinds": (KINDS, "in turn, some more often (all)", KINDS),
    },
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
