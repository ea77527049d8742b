"""First sentence and first act of fresh cells, scored by doing in a stranger's simulator what the first act says.

`scripts/dev acts 30 --seed 1` makes cells on circles by a generator that shares no code with rig (one to three faults,
sound, few runs, outside the library), diagnoses them by their runs with another place that only judges, does the first
act, and compares the error there before and after with what the act stated.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from analysis.inference.acts import Act
from analysis.inference.diagnose import diagnose
from analysis.inference.observation import ObservedRun, observe_run
from analysis.inference.result import Diagnosis
from analysis.inference.validation import left_um
from analysis.model.predict import model_of
from analysis.reporting.answer_words import AnswerWords, large_parts, sure_parts
from analysis.traces.loading import load_measured
from analysis.traces.tables import CircleTable
from dev.trials.blind.trial import Job, make_case, runs_of
from dev.trials.stranger import cases
from dev.trials.stranger.faults import Fault
from rigs.effects import Effect
from rigs.load import load
from rigs.schema.effect import name_of

KINDS = ("one", "two", "three", "none", "few", "outside")
"""As in the blind trial; `few` is two faults by a lap each way."""
_SEATS = ("axis", "field", "gauge", "from_axis", "to_axis")


@dataclass(frozen=True)
class Scored:
    """A cell: its kind and seed, the first sentence, the first act with what it stated and what came (µm at the other
    place), and whether the first sentence has what makes most."""

    kind: str
    seed: int
    headline: str
    act: Act
    before_um: float
    after_um: float
    is_named: bool | None

    @property
    def fell_as_stated(self) -> bool | None:
        """Whether the error is what the act stated within 2 u; None of acts that state nothing."""
        if self.act.kind in ("measure", "none") or (self.act.effect is None and self.act.kind != "load"):
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
            f"{self.kind:8s}{self.seed:4d}  {act.kind:9s}{act.why:15s} stated {stated}, came "
            f"{self.before_um:.1f} to {self.after_um:.1f}: {verdict}{' LARGER' * self.is_larger}; {named}: "
            f"{self.headline}"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("count", type=int, nargs="?", default=6, help="cells (6)")
    parser.add_argument("--seed", type=int, default=1, help="of the first cell (1)")
    given = parser.parse_args()
    done = []
    with tempfile.TemporaryDirectory() as directory:
        for k in range(given.count):
            done.append(scored(KINDS[k % len(KINDS)], given.seed + k, Path(directory)))
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


def scored(kind: str, seed: int, directory: Path) -> Scored:
    """A cell made, diagnosed and done as its first act says."""
    job = Job("two" if kind == "few" else kind, seed, "tolerance", directory)
    make_case(job)
    truth = json.loads(job.truth.read_text(encoding="utf-8"))
    places = runs_of(job.case)
    used = [load_measured(path) for path in places["train"]]
    if kind == "few":
        yaw = [run for run in used if run.run.manifest.test == "yaw"]
        used = list({run.run.manifest.direction: run for run in yaw}.values())
    unseen = [load_measured(path) for path in places["unseen"]]
    found = diagnose(used[0].rig, used, [], unseen, lambda _: None)
    act = found.acts[0]
    every = _faults(truth)
    before = left_um(*_twice(_driven(truth, job.case, every)), [])
    return Scored(
        kind, seed, AnswerWords(found).headline, act, before, _after(found, act, truth, job.case, every),
        _is_named(found, truth),
    )  # fmt: skip


def _after(found: Diagnosis, act: Act, truth: Mapping[str, Any], case: Path, every: Sequence[Any]) -> float:
    """The error there once the act is done: a cause that is repaired is gone, what is entered or corrected is taken off
    as the model has it."""
    if act.kind in ("repair", "mount", "wait") and act.effect is not None:
        rest = [fault for fault in every if fault.name != name_of(act.effect)]
        return left_um(*_twice(_driven(truth, case, rest)), [])
    return left_um(*_twice(_driven(truth, case, every)), _entered(found, act))


def _entered(found: Diagnosis, act: Act) -> list[Effect]:
    if act.kind == "load" and found.calibrated is not None:
        model = [*(one.effect for one in found.written), *found.calibrated.effects]
        return [one for one in model if one.compensation().use != "none"]
    return [act.effect] if act.kind in ("remaster", "enter") and act.effect else []


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


def _twice(runs: list[ObservedRun]) -> tuple[list[ObservedRun], list[ObservedRun]]:
    return runs, runs


def _is_named(found: Diagnosis, truth: Mapping[str, Any]) -> bool | None:
    """Whether the first sentence has what is hidden and shows most, by itself or as the likeliest of a group."""
    if not truth["hidden"]:
        return None
    largest = max(truth["hidden"], key=lambda one: float(one["snr"]))
    said = {name_of(one.effect) for one in found.standing}
    for part in (*large_parts(found), *sure_parts(found)):
        if part.index is not None:
            one = found.effects[part.index]
            said |= {name_of(one.effect), *(name_of(rival.effect) for rival in one.rivals)}
        said |= {name_of(one.effect) for one in part.members}
    return bool(said & set(largest["class"]))


if __name__ == "__main__":
    main()
