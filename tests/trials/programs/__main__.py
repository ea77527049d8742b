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

import argparse
import sys
import tempfile
from pathlib import Path

from tests.trials.programs.trial import Table, Verdict, grave, judge, story
from tests.worlds.languages.arms import CONTROLLERS, DIALECTS, choose_controller
from tests.worlds.languages.drawing import Draft
from tests.worlds.languages.grammars import draw

_HEAD = (
    f"{'dialect':9}{'programs':>9}{'refused':>8}{'reached':>8}{'changed':>8}{'done':>7}{'left':>7}{'farther':>8}"
    f"{'worst mm':>9}{'short':>6}{'silent':>7}{'bytes':>6}{'other':>6}{'plain %':>8}{'CPU s':>7}"
)


def main() -> int:
    """Print the table, and return 1 where a target is farther off and not listed, or more than numbers changed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("count", type=int, help="programs of each dialect")
    parser.add_argument("--dialect", choices=DIALECTS, action="append", help="only this one; can be repeated")
    parser.add_argument("--seed", type=int, default=0, help="the first seed")
    parser.add_argument("--keep", type=Path, help="directory for programs with faults; default: a new temporary one")
    parser.add_argument("--show", action="store_true", help="print what came of each program")
    parser.add_argument(
        "--controller",
        choices=CONTROLLERS,
        default="data_sheet",
        help="constants of the controllers: of the data sheet, or own ones, which the rig file states from the "
        "diagnosis, states afterwards, or does not state",
    )
    given = parser.parse_args()
    choose_controller(given.controller)
    keep = given.keep or Path(tempfile.mkdtemp(prefix="rig-programs-"))
    print(_HEAD, flush=True)
    bad = False
    for dialect in given.dialect or DIALECTS:
        wild, plain = Table(), Table()
        for seed in range(given.seed, given.seed + given.count):
            _one(draw(dialect, seed, plain=False), seed, wild, keep, show=given.show)
        for seed in range(given.seed, given.seed + -(-given.count // 5)):
            _one(draw(dialect, seed, plain=True), seed, plain, keep, show=given.show)
        print(_row(dialect, wild, plain), flush=True)
        if unknown := wild.reasons["controller_unknown"] + plain.reasons["controller_unknown"]:
            print(f"{'':9}poses left because the constants of the controller are unknown: {unknown}", flush=True)
        bad |= any(_counts(table)[0] or _counts(table)[3] or _counts(table)[4] for table in (wild, plain))
    print(f"programs with faults are in {keep}" if any(keep.glob("*")) else "no program had a fault")
    return int(bad)


def _one(draft: Draft, seed: int, table: Table, keep: Path, *, show: bool) -> None:
    verdict = judge(draft)
    table.add(verdict)
    if show:
        print(story(verdict))
    if verdict.faults:
        _keep(verdict, seed, keep)


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
    """Return the numbers of targets with a larger error, of short and of silent results, of changed bytes, and of other
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


if __name__ == "__main__":
    sys.exit(main())
