"""Crash states of a recording on a disk that forgets what was not synced (see tests/support/powercut.py)."""

from __future__ import annotations

import sys
import tempfile
from argparse import Namespace
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

from tests.support.powercut import IoWorker, survivors
from tests.support.powercut_trial import Outcome, Recording, recording, trial
from tests.support.trial import Trial, main

_EACH = 25
"""States of one recording; then another is made."""


def draw(given: Namespace) -> Iterator[range]:
    """Seeds of the states of one recording."""
    end = given.seed + given.count
    for start in range(given.seed - given.seed % _EACH, end, _EACH):
        yield range(max(start, given.seed), min(start + _EACH, end))


def judged(states: range) -> tuple[list[Outcome], list[str]]:
    """Recover every state of a recording and compare it with what the store had promised."""
    outcomes, wrong = [], []
    with tempfile.TemporaryDirectory(prefix="rig-powercut-") as scratch:
        recorded = _recorded(Path(scratch) / "recorded", states[0] // _EACH)
        for number in states:
            try:
                outcomes.append(trial(recorded, Path(scratch) / str(number), number))
            except Exception as error:  # noqa: BLE001 - every kind of failure is a state that failed
                wrong.append(f"seed {number}: {type(error).__name__}: {str(error).partition(chr(10))[0]}")
    return outcomes, wrong


def _recorded(folder: Path, seed: int) -> Recording:
    (folder / "recording").mkdir(parents=True)
    recorded = recording(folder / "recording", seed)
    assert survivors(recorded.before, recorded.log, None).tree() == IoWorker.read(folder / "recording").tree(), (
        "the store changed a file beside daq.store.durable"
    )
    return recorded


def report(done: Sequence[tuple[list[Outcome], list[str]]]) -> str:
    outcomes, wrong = [one for own, _ in done for one in own], [line for _, own in done for line in own]
    kinds = Counter(outcome.kind for outcome in outcomes)
    told = ", ".join(f"{count} {kind}" for kind, count in kinds.most_common())
    twice = sum(outcome.cut_twice for outcome in outcomes)
    promised, beyond = sum(o.promised for o in outcomes), sum(o.beyond for o in outcomes)
    return "\n".join([
        f"{len(outcomes) + len(wrong)} crash states, {_EACH} of each recording: {told}",
        f"{twice} of them cut a second time while they were recovered",
        f"{promised} rows were synced, all are there and bit-equal; {beyond} more that were not synced yet are right",
        f"{len(wrong)} states wrong" if wrong else "no verified chunk lost, none wrong",
    ])  # fmt: skip


def is_wrong(done: Sequence[tuple[list[Outcome], list[str]]]) -> bool:
    return any(wrong for _, wrong in done)


TRIAL = Trial(
    draw,
    judged,
    report,
    line=lambda one: "\n".join(one[1]),
    failed=is_wrong,
    count=500,
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
