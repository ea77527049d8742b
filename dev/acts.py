"""First sentence and first act of fresh cells, scored by doing in a stranger's simulator what the first act says.

`scripts/dev acts 60 --seed 1` makes cells on circles, of poses and of touches by generators that share no code with rig
(one to three faults, sound, few runs, outside the library), diagnoses them by their runs with another place that only
judges, does the first act, and compares the error there before and after with what the act stated.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from analysis.inference.acts import Act
from analysis.inference.diagnose import diagnose
from analysis.inference.observation import ObservedRun, by_socket, observe_run
from analysis.inference.result import Diagnosis
from analysis.inference.setups import FittedRuns
from analysis.inference.validation import left_um
from analysis.model.predict import model_of
from analysis.reporting.answer_words import AnswerWords, large_parts, sure_parts
from analysis.traces.loading import Measured, load_measured
from analysis.traces.tables import CircleTable, PoseTable, TouchTable
from dev.trials.blind.trial import Job, make_case, runs_of
from dev.trials.stranger import cases
from dev.trials.stranger.faults import Fault
from rigs.arms import load_arm
from rigs.effects import Effect
from rigs.load import load, parse
from rigs.rig import Rig
from rigs.schema.effect import name_of
from tests.support import seven_axes

KINDS = ("one", "two", "three", "none", "few", "outside")
"""As in the blind trial; `few` is two faults by a lap each way, or by a fourth of the poses or touches."""
WAYS = ("circles", "poses", "touches")
ARMS = ("ur10e", "franka-fr3")
"""Arms of the library that are measured by poses and touches, in turn."""
BALL_MM = np.array([10.0, -5.0, 120.0])
POSES, TOUCHES, SOCKETS, FEWER = 100, 80, 2, 4
_FAULTS = {"one": 1, "two": 2, "three": 3, "few": 2}
_SLIP_DEG = (0.05, 0.2)
_SEATS = ("axis", "field", "gauge", "from_axis", "to_axis", "other")
_DONE = ("repair", "mount", "remaster", "enter", "load")
"""Acts that change the arm or what is sent to it."""


@dataclass(frozen=True)
class Cell:
    """A cell: its runs, those of another place, and the error there (µm) of the stranger's arm without the cause of a
    name, beside effects that are entered. `hidden` has the names that count as each of what is hidden, the one that
    makes most first."""

    rig: Rig
    used: Sequence[Measured]
    unseen: Sequence[Measured]
    error_um: Callable[[str | None, Sequence[Effect]], float]
    hidden: Sequence[frozenset[str]]


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

    @property
    def fell_as_stated(self) -> bool | None:
        """Whether the error is what the act stated within 2 u; None of acts that state nothing."""
        if self.act.kind not in _DONE or (self.act.effect is None and self.act.kind != "load"):
            return None
        return abs(self.after_um - self.act.remains_um) <= 2 * self.act.remains_u_um

    @property
    def is_larger(self) -> bool:
        """Whether the act made the error larger, by more than a twentieth."""
        return self.after_um > 1.05 * self.before_um

    def __str__(self) -> str:
        act = self.act
        stated = f"{act.removes_um + act.remains_um:.1f} to {act.remains_um:.1f} ± {act.remains_u_um:.1f}"
        verdict = {True: "as stated", False: "NOT as stated", None: "states nothing"}[self.fell_as_stated]
        named = {True: "named", False: "NOT NAMED", None: "-"}[self.is_named]
        return (
            f"{self.kind:8s}{self.way:8s}{self.seed:4d}  {self.seconds:5.1f} s {act.kind:9s}{act.why:15s} stated "
            f"{stated}, came {self.before_um:.1f} to {self.after_um:.1f}: {verdict}{' LARGER' * self.is_larger}; "
            f"{named}: {self.headline}"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("count", type=int, nargs="?", default=6, help="cells (6)")
    parser.add_argument("--seed", type=int, default=1, help="of the first cell, which decides its kind and way too (1)")
    parser.add_argument("--ways", nargs="*", choices=WAYS, default=WAYS, help="circles, poses, touches (all)")
    parser.add_argument("--minutes", type=float, default=60.0, help="begin no further cell after so many minutes (60)")
    given = parser.parse_args()
    done, begin = [], time.monotonic()
    with tempfile.TemporaryDirectory() as directory:
        for k in range(given.count):
            if time.monotonic() - begin > 60 * given.minutes:
                break
            seed = given.seed + k
            way = given.ways[(seed + seed // len(KINDS)) % len(given.ways)]
            done.append(scored(KINDS[seed % len(KINDS)], way, seed, Path(directory)))
            print(done[-1], flush=True)
    print(table(done))


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
    ])  # fmt: skip


def scored(kind: str, way: str, seed: int, directory: Path) -> Scored:
    """A cell made, diagnosed and done as its first act says."""
    cell = of_circles(kind, seed, directory) if way == "circles" else of_places(kind, way, seed)
    begin = time.process_time()
    found = diagnose(cell.rig, cell.used, [], cell.unseen, lambda _: None)
    seconds = time.process_time() - begin
    act = found.acts[0]
    return Scored(
        kind, way, seed, AnswerWords(found).headline, act, cell.error_um(None, []), _after(found, act, cell),
        _is_named(found, cell.hidden), seconds,
    )  # fmt: skip


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
    for part in (*large_parts(found), *sure_parts(found)):
        if part.index is not None:
            one = found.effects[part.index]
            said |= {name_of(one.effect), *(name_of(rival.effect) for rival in one.rivals)}
        said |= {name_of(one.effect) for one in part.members}
    return bool(said & hidden[0])


# ----------------------------------------------------------------------------------------------------------------------
# Circles: the stranger's blind cases, with another place of the ball.


def of_circles(kind: str, seed: int, directory: Path) -> Cell:
    """A cell of circles of `dev.trials.stranger`."""
    job = Job("two" if kind == "few" else kind, seed, "tolerance", directory)
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
        return left_um(driven, FittedRuns(driven), entered)

    hidden = sorted(truth["hidden"], key=lambda one: -float(one["snr"]))
    return Cell(used[0].rig, used, unseen, error_um, [frozenset(one["class"]) for one in hidden])


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
    session, _ = cases._begun(truth["kind"], truth["seed"], truth["scale"])
    model, link, runs = model_of(load(str(case / "unseen.yaml"))[0]), session.links["unseen"], []
    for lap in session.laps("unseen", list(faults)):
        run = cases._Run("yaw", lap.direction, "unseen")
        plain = cases.measure(session.unseen[0], session.motion(run, np.random.default_rng(0)), [], link)
        table = CircleTable("yaw", lap.direction, lap.t_s, lap.q, plain + lap.added)  # type: ignore[arg-type]
        runs.append(observe_run(model, table, f"yaw {lap.direction}"))
    return runs


# ----------------------------------------------------------------------------------------------------------------------
# Poses and touches: arms of `tests.support.seven_axes`, with a tracker in another place, or sockets elsewhere.


def of_places(kind: str, way: str, seed: int) -> Cell:
    """A cell of poses before a tracker, or of touches of two sockets."""
    rng = np.random.default_rng([52, seed])
    letters = ", ".join(f'"{letter}"' for letter in "ABCD"[:SOCKETS])
    arm = load_arm(ARMS[seed % len(ARMS)])
    rig = parse(f"name: cell\n{arm.text}tests: {{touch: {{sockets: [{letters}]}}}}\n", "cell.yaml")
    faults = seven_axes.draw_faults(rig.robot, rng, _FAULTS.get(kind, 0))
    slip = None
    if kind == "outside":
        slip = (int(rng.integers(1, 4)), float(rng.uniform(-0.3, 0.3)), float(np.radians(rng.uniform(*_SLIP_DEG))))

    def arm_with(rest: Sequence[seven_axes.Fault]) -> seven_axes.Truth:
        drawn = seven_axes.draw_truth(rig.robot, np.random.default_rng([53, seed]), tuple(rest))
        return replace(drawn, slip=slip)

    fewer = FEWER if kind == "few" else 1
    measured = partial(_measured, rig, way)
    used = measured(arm_with(faults), np.random.default_rng([54, seed]), fewer)
    unseen = measured(arm_with(faults), np.random.default_rng([55, seed]), 1)

    def error_um(repaired: str | None, entered: Sequence[Effect]) -> float:
        rest = [fault for fault in faults if fault.name != repaired]
        still = replace(arm_with(rest), scatter_mm=0.0)
        there = observe_run(model_of(rig), measured(still, np.random.default_rng([55, seed]), 1), way)
        runs = by_socket(there)
        return left_um(runs, FittedRuns(runs), entered)

    whole = error_um(None, [])
    makes = {fault.name: whole**2 - error_um(fault.name, []) ** 2 for fault in faults}
    hidden = [frozenset([name]) for name in sorted(makes, key=lambda name: -makes[name])]
    runs = (seven_axes.run_of(rig, table, name, name) for table, name in ((used, "used"), (unseen, "unseen")))
    return Cell(rig, [next(runs)], [next(runs)], error_um, hidden)


def _measured(
    rig: Rig, way: str, truth: seven_axes.Truth, rng: np.random.Generator, fewer: int
) -> PoseTable | TouchTable:
    if way == "poses":
        return seven_axes.pose_table(rig.robot, truth, rng, BALL_MM, POSES // fewer)
    return seven_axes.touch_table(rig.robot, truth, rng, BALL_MM, SOCKETS, TOUCHES // fewer)


if __name__ == "__main__":
    main()
