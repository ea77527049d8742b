"""Crash states of a recording on a disk that forgets what was not synced (see tests/support/powercut.py)."""

from __future__ import annotations

import tempfile
from collections import Counter
from pathlib import Path
from typing import Annotated

import typer

from tests.support.powercut import IoWorker, survivors
from tests.support.powercut_trial import Outcome, Recording, recording, trial

_EACH = 25
"""States of one recording; then another is made."""


def main(
    states: Annotated[int, typer.Option(help="How many crash states.")] = 500,
    seed: Annotated[int, typer.Option(help="Of the first state; with --states 1 that state alone.")] = 0,
) -> None:
    """Recover every state and hold it to what the store had promised."""
    outcomes: list[Outcome] = []
    wrong: list[str] = []
    with tempfile.TemporaryDirectory(prefix="rig-powercut-") as scratch:
        for number in range(seed, seed + states):
            folder = Path(scratch) / str(number)
            if number == seed or number % _EACH == 0:
                recorded = _recorded(folder, number // _EACH)
            try:
                outcomes.append(trial(recorded, folder, number))
            except Exception as error:  # noqa: BLE001 - every kind of failure is a state that failed
                wrong.append(f"seed {number}: {type(error).__name__}: {str(error).partition(chr(10))[0]}")
                print(wrong[-1])
    report(outcomes, states, seed)
    print(f"{len(wrong)} of {states} states wrong" if wrong else "no verified chunk lost, none wrong")
    raise typer.Exit(1 if wrong else 0)


def _recorded(folder: Path, seed: int) -> Recording:
    (folder / "recording").mkdir(parents=True)
    recorded = recording(folder / "recording", seed)
    assert survivors(recorded.before, recorded.log, None).tree() == IoWorker.read(folder / "recording").tree(), (
        "the store changed a file beside daq.store.durable"
    )
    return recorded


def report(outcomes: list[Outcome], states: int, seed: int) -> None:
    """What was seen, in figures."""
    kinds = Counter(outcome.kind for outcome in outcomes)
    told = ", ".join(f"{count} {kind}" for kind, count in kinds.most_common())
    twice = sum(outcome.cut_twice for outcome in outcomes)
    print(f"{states} crash states, seeds {seed} to {seed + states - 1}, {_EACH} of each recording: {told}")
    print(f"{twice} of them cut a second time while they were recovered")
    promised, beyond = sum(o.promised for o in outcomes), sum(o.beyond for o in outcomes)
    print(f"{promised} rows were synced, all are there and bit-equal; {beyond} more that were not synced yet are right")


if __name__ == "__main__":
    typer.run(main)
