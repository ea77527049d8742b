"""Drawn programs of five dialects, corrected, and driven on every way before and after by other interpreters.

    scripts/dev programs 100                            # of each dialect, and a fifth as many plain ones
    scripts/dev programs 10000 --dialect fanuc --seed 5
    scripts/dev programs 1 --seed 4711 --show           # one program, with what came of it
    scripts/dev programs 100 --controller unknown       # controllers with constants of their own, not stated

Each target that is reached on any way (unknown conditions either way, loops none, once and twice, unknown values in two
worlds) is held against where the text wants the tool: a wrong arm whose rig file names what is wrong drives both
programs. `farther` are targets that the correction changed and that are farther off than before by more than 2 u, or in
another posture; `short` changed and are still off by more than 2 u, as of a wrong tool or frame; `silent` are neither
changed nor listed; `bytes` is whatever else changed in a file. Programs with one of these are kept with their story.
"""

from __future__ import annotations

import sys
import tempfile
from argparse import Namespace
from collections.abc import Iterator, Sequence
from pathlib import Path

from tests.support.trial import Trial, main, seeds
from tests.trials.programs.trial import Table, Verdict, grave, judge, story
from tests.worlds.languages.arms import CONTROLLERS, DIALECTS, choose_controller
from tests.worlds.languages.grammars import draw

_HEAD = (
    f"{'dialect':9}{'programs':>9}{'refused':>8}{'reached':>8}{'changed':>8}{'done':>7}{'left':>7}{'farther':>8}"
    f"{'worst mm':>9}{'short':>6}{'silent':>7}{'bytes':>6}{'other':>6}{'plain %':>8}{'CPU s':>7}"
)


Case = tuple[str, int, bool, str, Path, bool]
"""Dialect, seed, whether plain, controller, directory for programs with faults, whether the story is shown."""


def draw_cases(given: Namespace) -> Iterator[Case]:
    keep = given.keep or Path(tempfile.mkdtemp(prefix="rig-programs-"))
    for dialect in given.dialect:
        for plain, count in ((False, given.count), (True, -(-given.count // 5))):
            for seed in list(seeds(given))[:count]:
                yield dialect, seed, plain, given.controller, keep, given.show


def judged(case: Case) -> tuple[str, bool, Verdict, Path]:
    dialect, seed, plain, controller, keep, show = case
    choose_controller(controller)
    verdict = judge(draw(dialect, seed, plain=plain))
    if show:
        print(story(verdict))
    if verdict.faults:
        _keep(verdict, seed, keep)
    return dialect, plain, verdict, keep


def tables(done: Sequence[tuple[str, bool, Verdict, Path]]) -> Iterator[tuple[str, Table, Table]]:
    """Dialect, and the counts of wild and of plain programs."""
    for name in dict.fromkeys(name for name, *_ in done):
        wild, plain = Table(), Table()
        for dialect, is_plain, verdict, _ in done:
            if dialect == name:
                (plain if is_plain else wild).add(verdict)
        yield name, wild, plain


def report(done: Sequence[tuple[str, bool, Verdict, Path]]) -> str:
    lines, keep = [_HEAD], done[0][3]
    for dialect, wild, plain in tables(done):
        lines.append(_row(dialect, wild, plain))
        if unknown := wild.reasons["controller_unknown"] + plain.reasons["controller_unknown"]:
            lines.append(f"{'':9}poses left because the constants of the controller are unknown: {unknown}")
    return "\n".join(
        [*lines, f"programs with faults are in {keep}" if any(keep.glob("*")) else "no program had a fault"]
    )


def is_bad(done: Sequence[tuple[str, bool, Verdict, Path]]) -> bool:
    """True if an unlisted target became worse, or anything except numbers changed."""
    counts = [_counts(table) for _, *both in tables(done) for table in both]
    return any(farther or changed or others for farther, _, _, changed, others in counts)


def _keep(verdict: Verdict, seed: int, keep: Path) -> None:
    """Write the program and its story to a directory that says the worst of its faults."""
    worst = (
        min(verdict.faults, key=lambda fault: (not grave(fault), fault.kind)).kind.replace(" ", "-").replace(",", "")
    )
    draft = verdict.draft
    directory = keep / f"{worst}-{draft.dialect}-{'plain-' if draft.plain else ''}{seed}"
    directory.mkdir(parents=True, exist_ok=True)
    for name, data in draft.files.items():
        (directory / name).write_bytes(data)
    (directory / "story.txt").write_text(story(verdict), encoding="utf-8")


def _counts(table: Table) -> tuple[int, int, int, int, int]:
    """Numbers of targets with a larger error, of short and of silent results, of changed bytes, and of other
    problems.
    """
    faults = table.faults
    farther = faults["farther off"] + faults["another posture"]
    known = {"farther off", "another posture", "short", "silent", "bytes", "left, yet changed"}
    others = sum(count for kind, count in faults.items() if kind not in known and not kind.endswith("listed"))
    return farther, faults["short"], faults["silent"], faults["bytes"] + faults["left, yet changed"], others


def _row(dialect: str, wild: Table, plain: Table) -> str:
    farther, short, silent, changed, others = (a + b for a, b in zip(_counts(wild), _counts(plain), strict=True))
    share = 100 * plain.moved / max(plain.targets, 1)
    return (
        f"{dialect:9}{wild.verdicts:9}{wild.refused + plain.refused:8}{wild.targets:8}{wild.moved:8}{wild.done:7}"
        f"{wild.left:7}{farther:8}{max(wild.worst_mm, plain.worst_mm):9.3f}{short:6}{silent:7}{changed:6}{others:6}"
        f"{share:8.1f}{wild.seconds + plain.seconds:7.1f}"
    )


TRIAL = Trial(
    draw_cases,
    judged,
    report,
    line=lambda one: "",
    failed=is_bad,
    count=100,
    options={
        "dialect": (DIALECTS, "dialects (all)", DIALECTS),
        "keep": (Path, "directory for programs with faults; default: a new temporary one"),
        "show": (False, "print what came of each program"),
        "controller": (
            "data_sheet",
            "constants of the controllers: of the data sheet, or own ones the rig file states, adds or lacks",
            CONTROLLERS,
        ),
    },
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
