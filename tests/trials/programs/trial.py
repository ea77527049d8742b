"""A drawn program before and after its correction, driven on every way: what moved farther off, what nobody said."""

from __future__ import annotations

import difflib
import re
import tempfile
import time
from collections import Counter
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from analysis.apps.correct.corrected_program import correct_program
from analysis.apps.correct.stated_frames import frames_of
from analysis.apps.correct.stated_points import computed_points
from rigs.errors import RigError
from tests.worlds.languages import fanuc, inform, krl, rapid, urscript
from tests.worlds.languages.arms import Array, cell
from tests.worlds.languages.drawing import Draft, stated
from tests.worlds.languages.execution import Ended, Place, Reached, Ways, World, every_way

MACHINES: Mapping[str, Any] = {"ur": urscript, "abb": rapid, "kuka": krl, "fanuc": fanuc, "yaskawa": inform}
WORLDS, WAYS = 2, 20
_NUMBER = re.compile(rb" *[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_SAME_RAD, _TURNED_RAD = 1e-7, 0.3
"""Joint angles that differ by less are the same; a correction of this arm is far below 0.3 rad: beyond, it is another
posture."""


@dataclass(frozen=True)
class Corrected:
    """What a correction made of a draft: the bytes of all files, places of what it corrected and left, and
    the names of the files that were handed in."""

    files: dict[str, bytes]
    done: frozenset[Place]
    left: tuple[tuple[Place, str], ...]
    u_mm: float
    read: frozenset[str] = frozenset()
    given_mm: Mapping[Place, float] = field(default_factory=dict)
    """By how much places beside a target stay off that take its correction, as the product reports it."""
    shared_mm: Mapping[Place, float] = field(default_factory=dict)
    """Remaining error of listed places that share the correction of a target, NaN if it is listed as unknown."""


@dataclass(frozen=True)
class Fault:
    """Something that must not be: what, where, and error before and after in mm."""

    kind: str
    place: Place
    before_mm: float = 0.0
    after_mm: float = 0.0


@dataclass
class Verdict:
    """Result of a draft. `asked`: reached targets; `moved`: corrected targets."""

    draft: Draft
    corrected: Corrected | None = None
    faults: list[Fault] = field(default_factory=list)
    asked: int = 0
    moved: int = 0
    before_mm: float = 0.0
    after_mm: float = 0.0
    error: str = ""
    seconds: float = 0.0


def correct(draft: Draft) -> Corrected:
    rig = cell(draft.dialect).rig
    tools = [f"{name}={stated(T)}" for name, T in draft.tools.items()]
    frames = [f"{name}={stated(T)}" for name, T in draft.frames.items()]
    files, done, left, u_mm = dict(draft.files), set[Place](), [], [0.0]
    read, given_mm, shared_mm = set[str](), dict[Place, float](), dict[Place, float]()
    scale = inform.SCALE if draft.dialect == "yaskawa" else None
    with tempfile.TemporaryDirectory() as directory:
        for name, data in draft.files.items():
            (Path(directory) / name).write_bytes(data)
        for name in draft.given:
            one = correct_program(
                computed_points(rig), Path(directory) / name, frames_of(rig.robot, tools, frames), scale
            )
            names = list(one.files)
            files |= one.files
            read |= set(names)
            done |= {(names[file], line) for file, line in one.places}
            left += [((one.sources[item.file], item.line), item.reason) for item in one.left]
            u_mm += one.u_mm.tolist()
            given = zip(one.places, one.given_away_mm.tolist(), strict=True)
            given_mm |= {(names[file], line): mm for (file, line), mm in given if np.isfinite(mm)}
            shared_mm |= {(one.sources[item.file], item.line): item.after_mm for item in one.shared}
    return Corrected(files, frozenset(done), tuple(left), max(u_mm), frozenset(read), given_mm, shared_mm)


_REFUSED = (TypeError, ValueError, IndexError, KeyError, RecursionError)
"""Of values that a controller refuses as well: it stops there, before and after."""


_CYCLES = ("abb", "yaskawa")
"""Their programs begin again when they end, with tools, frames and shifts as they are then; every second world."""


def _texts(files: Mapping[str, bytes]) -> dict[str, str]:
    return {name: data.decode("latin-1").removeprefix("ï»¿") for name, data in files.items()}


def reached(draft: Draft, program: Any, world: World, ways: Ways) -> list[Reached]:
    machine = MACHINES[draft.dialect].Machine(program, world, ways)
    with suppress(Ended, *_REFUSED):
        machine.run()
        if draft.dialect in _CYCLES and world.seed % 2:
            machine.run()
    return list(machine.robot.reached)


def judge(draft: Draft) -> Verdict:
    begin = time.process_time()
    verdict = Verdict(draft)
    try:
        verdict.corrected = corrected = correct(draft)
    except RigError as error:
        verdict.error = str(error)
        verdict.seconds = time.process_time() - begin
        return verdict
    except Exception as error:  # noqa: BLE001 - a traceback is a fault of the program under test
        verdict.error = repr(error)
        verdict.faults.append(Fault(f"crash {type(error).__name__}", (draft.main, 0)))
        return verdict
    verdict.faults += _bytes(draft, corrected) + _touched(draft, corrected)
    if not any(fault.kind == "bytes" for fault in verdict.faults):
        _drive(draft, corrected, verdict)
    verdict.seconds = time.process_time() - begin
    return verdict


def _bytes(draft: Draft, corrected: Corrected) -> list[Fault]:
    """A fault for each file of which more than numbers changed."""
    return [
        Fault("bytes", (name, 0))
        for name, data in draft.files.items()
        if _NUMBER.sub(b"#", data) != _NUMBER.sub(b"#", corrected.files[name])
    ]


def _touched(draft: Draft, corrected: Corrected) -> list[Fault]:
    """A fault for each target that is listed as uncorrected although its line changed and contains no other
    target.
    """
    before, after = _texts(draft.files), _texts(corrected.files)
    return [
        Fault("left, yet changed", (name, line))
        for name, line in {place for place, _ in corrected.left} - corrected.done
        if name in before and before[name].splitlines()[line - 1 : line] != after[name].splitlines()[line - 1 : line]
    ]


def _drive(draft: Draft, corrected: Corrected, verdict: Verdict) -> None:
    language = MACHINES[draft.dialect]
    before = language.Program(_texts(draft.files), draft.main)
    same = corrected.files == draft.files  # and drives the same ways
    after = before if same else language.Program(_texts(corrected.files), draft.main)
    seen: set[tuple[Any, ...]] = set()
    pairs: dict[tuple[Any, ...], tuple[Reached, Reached]] = {}
    for seed in range(WORLDS):
        shared = {("tool", name.lower()): T for name, T in draft.tools.items()}
        world = World(seed, shared | {("frame", name.lower()): T for name, T in draft.frames.items()})
        driven: set[tuple[int, ...]] = set()
        for ways in every_way(WAYS, seed):
            first = reached(draft, before, world, ways)
            if (taken := tuple(ways.taken)) in driven:
                continue  # drawn once more
            driven.add(taken)
            again = first if same else reached(draft, after, world, Ways(taken))
            places, others = ([one.place for one in way] for way in (first, again))
            shorter = min(len(places), len(others))
            if places[:shorter] != others[:shorter]:
                verdict.faults.append(Fault("another way", first[-1].place if first else (draft.main, 0)))
            elif len(places) != len(others):
                verdict.faults.append(Fault("stops elsewhere", max(first, again, key=len)[shorter].place))
            for one, other in zip(first, again, strict=False):
                exact = (one.place, one.sources, one.q.tobytes(), one.F.tobytes(), other.q.tobytes())
                if exact in seen:
                    continue
                seen.add(exact)
                key = (
                    one.place,
                    one.sources,
                    one.q.round(9).tobytes(),
                    one.F.round(6).tobytes(),
                    other.q.round(9).tobytes(),
                )
                pairs.setdefault(key, (one, other))
    _compare(draft, corrected, list(pairs.values()), verdict)


def _compare(draft: Draft, corrected: Corrected, pairs: list[tuple[Reached, Reached]], verdict: Verdict) -> None:
    if not pairs:
        return
    here = cell(draft.dialect)
    mm = [_off_mm(here.flanges(np.array([pair[k].q for pair in pairs])), pairs) for k in (0, 1)]
    listed = {place for place, _ in corrected.left}
    slack = 2 * max(corrected.u_mm, 0.005)
    asked: dict[tuple[Place, frozenset[Place]], list[bool]] = {}
    for (one, other), before, after in zip(pairs, *mm, strict=True):
        kept_mm = corrected.shared_mm.get(one.place, 0.0)
        said = bool(listed & {one.place, *one.sources}) or np.isnan(kept_mm)
        step = float(np.abs(other.q - one.q).max())
        moved = step > _SAME_RAD
        asked.setdefault((one.place, one.sources), []).append(moved)
        verdict.before_mm, verdict.after_mm = max(verdict.before_mm, before), max(verdict.after_mm, after)
        kind = ""
        if moved and step > _TURNED_RAD:
            kind = "another posture, listed" if said else "another posture"
        elif moved and after > max(before, kept_mm) + slack:
            kind = "farther off, listed" if said else "farther off"
        elif moved and after > slack + max(
            kept_mm, *(corrected.given_mm.get(source, 0.0) for source in one.sources), 0.0
        ):
            kind = "short, listed" if said else "short"
        elif not moved and before > slack and not said and corrected.read & {name for name, _ in one.sources}:
            kind = "silent"
        if kind:
            verdict.faults.append(Fault(kind, one.place, before, after))
    verdict.asked = len(asked)
    verdict.moved = sum(all(moved) for moved in asked.values())


def _off_mm(F: Array, pairs: list[tuple[Reached, Reached]]) -> list[float]:
    points = np.array([one.point for one, _ in pairs])
    wanted = np.array([one.F for one, _ in pairs])
    away = np.einsum("nij,nj->ni", F[:, :3, :3] - wanted[:, :3, :3], points) + F[:, :3, 3] - wanted[:, :3, 3]
    return [float(mm) for mm in np.linalg.norm(away, axis=1)]


GRAVE = ("farther off", "another posture", "bytes", "another way", "left, yet changed", "crash")
"""Kinds of faults that must never occur."""


def grave(fault: Fault) -> bool:
    """True if a fault is one that must never be."""
    return fault.kind.startswith(GRAVE) and not fault.kind.endswith("listed")


def story(verdict: Verdict) -> str:
    """Return what a person needs to look at a verdict: faults, lists and the changed lines."""
    lines = [
        f"{fault.kind}: {fault.place} {fault.before_mm:.3f} -> {fault.after_mm:.3f} mm" for fault in verdict.faults
    ]
    draft, corrected = verdict.draft, verdict.corrected
    lines += [f"--tool {name}={stated(T)}" for name, T in draft.tools.items()]
    lines += [f"--frame {name}={stated(T)}" for name, T in draft.frames.items()]
    if corrected:
        lines += [f"corrected: {place}" for place in sorted(corrected.done)]
        lines += [f"left: {place} {why}" for place, why in corrected.left]
        after = _texts(corrected.files)
        for name, text in _texts(draft.files).items():
            lines += difflib.unified_diff(
                text.splitlines(), after[name].splitlines(), name, "corrected", "", "", 99, ""
            )
    return "\n".join([verdict.error, *lines]) + "\n"


@dataclass
class Table:
    """Counts over the verdicts of a dialect."""

    verdicts: int = 0
    targets: int = 0
    moved: int = 0
    done: int = 0
    left: int = 0
    refused: int = 0
    worst_mm: float = 0.0
    seconds: float = 0.0
    faults: Counter[str] = field(default_factory=Counter)
    reasons: Counter[str] = field(default_factory=Counter)

    def add(self, verdict: Verdict) -> None:
        self.verdicts += 1
        self.targets += verdict.asked
        self.moved += verdict.moved
        self.seconds += verdict.seconds
        self.refused += bool(verdict.error)
        if verdict.corrected:
            self.done += len(verdict.corrected.done)
            self.left += len(verdict.corrected.left)
            self.reasons.update(why for _, why in verdict.corrected.left)
        for fault in verdict.faults:
            self.faults[fault.kind] += 1
            if grave(fault):
                self.worst_mm = max(self.worst_mm, fault.after_mm - fault.before_mm)
