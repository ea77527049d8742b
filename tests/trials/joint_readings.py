"""Imports of pose tables whose joints have other zeros, directions or units than the rig file.

`scripts/dev joint_readings 200` draws tables of six-axis arms with up to three zeros of ±20° or a quarter turn,
reversed joints, and angles in degrees, radians, gon, turns or counts. The places are those of healthy arms by
independent kinematics. Goal: 95 % right or asked, none wrong.
"""

from __future__ import annotations

import sys
import tempfile
from argparse import Namespace
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from tests.support.misread_joints import Misread, draw_misread, outcome_of
from tests.support.trial import Trial, main, seeds

Case = tuple[int, Misread]


def draw(given: Namespace) -> Iterator[Case]:
    yield from ((seed, draw_misread(np.random.default_rng([97, seed]))) for seed in seeds(given))


def judge(case: Case) -> list[str]:
    seed, table = case
    with tempfile.TemporaryDirectory(prefix="rig-joints-") as folder:
        outcome, words = outcome_of(table, Path(folder))
    return [str(seed), outcome, table.words, words]


def report(results: Sequence[list[str]]) -> str:
    count = Counter(outcome for _, outcome, *_ in results)
    return ", ".join(f"{outcome} {count[outcome]}" for outcome in ("right", "equivalent", "asked", "wrong"))


TRIAL = Trial(
    draw, judge, report, failed=lambda results: any(outcome == "wrong" for _, outcome, *_ in results), count=200
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
