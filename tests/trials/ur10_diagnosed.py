"""The findings of `rig diagnose` in a real UR10 (Fraunhofer IPA, laser tracker), judged on poses left out.

For each series and fold: names and a healthy arm's share of everything from the poses of four fifths of the
neighbourhoods in joint space, then the frozen model on the fifth that had no part in it, beside the nominal arm and a
least-squares fit of 24 parameters by another solver. Then names from a whole series, frozen on the others, measured
months apart.
"""

from __future__ import annotations

import sys
import time
from argparse import Namespace
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from analysis.diagnosis.evidence.observation import ObservedRun, observe_run
from analysis.diagnosis.evidence.setups import FittedRuns, without_a_fold
from analysis.diagnosis.fit.responses import rms_by_block
from analysis.diagnosis.fit.search import SearchResult, search
from analysis.diagnosis.judge.alternatives import hypotheses_of
from analysis.diagnosis.judge.budget import effect_changes
from analysis.diagnosis.judge.validation import gap, stages_of
from analysis.diagnosis.judge.verdict import named_effects
from analysis.robot.model.predict import model_of
from analysis.runs.tables import PoseTable
from rigs.load import load
from rigs.rig import Rig
from rigs.schema.effect import label_of
from tests.support.measured_series import DATA
from tests.support.trial import Trial, main
from tests.trials.ur10 import read
from tests.worlds.arms.independent_arm import Peer, Seen, constants_of, least_squares_fit

ARM = constants_of("ur10")
LISTED = 12
"""Healthy shares that are printed, the most worth first."""


def faults(look: SearchResult, seen: ObservedRun) -> list[tuple[str, float]]:
    """The faults, each with what it does to the readings in µm."""
    gains = [None] * len(look.effects)
    found = named_effects(look, hypotheses_of(look), FittedRuns([seen]), gains, effect_changes(look))
    return [(label_of(one.effect), one.contribution_um) for one in found if one.is_confirmed]


def shares_of(look: SearchResult) -> list[tuple[str, float]]:
    """What a healthy arm's share of each name is worth in µm, the most first."""
    columns: dict[str, list[int]] = {}
    for form in look.columns.forms:
        columns.setdefault(form.name, []).extend(form.columns)
    X, mean = look.columns.X, look.posterior.mean
    own = [(name, rms_by_block(look.linear, X[:, cols] @ mean[cols]).whole_um) for name, cols in columns.items()]
    return sorted(own, key=lambda one: -one[1])


def told(pairs: list[tuple[str, float]]) -> str:
    return ", ".join(f"{name} {um:.0f} µm" for name, um in pairs) or "none"


def seen_of(run: ObservedRun) -> Seen:
    """The poses of a run, for the other solver."""
    return Seen(run.table.q[run.rows], run.values)


def plain_of(run: ObservedRun) -> Peer:
    """Zeros, and a, alpha and d of each axis, by least squares of another solver."""
    return least_squares_fit(ARM, seen_of(run), "joint_offset,link_geometry")


def in_own_setup(run: ObservedRun, name: str) -> ObservedRun:
    """A run of another series as a separate set-up, because the instrument was moved."""
    return replace(run, setup=f"{run.setup} of {name}")


def judged(rig: Rig, table: PoseTable, series: str, folds: int, only: int) -> None:
    """Every fold of a series, told line by line."""
    seen = observe_run(model_of(rig), table, f"series {series}")
    print(f"series {series.upper()}: {len(table.q)} poses", flush=True)
    rows: list[tuple[int, float, float, float]] = []
    names: Counter[str] = Counter()
    for k in range(only or folds):
        begin = time.perf_counter()
        (used,), (left_out,) = without_a_fold([seen], folds, k)
        plain_mm = plain_of(used).held_out_mm(ARM, seen_of(left_out), again=False)
        look = search([used], lambda doing: None)
        after = gap([left_out], stages_of(FittedRuns([used]), look), look, [series])
        rows.append((len(left_out.rows), 1e-3 * after.before_um, plain_mm, 1e-3 * after.calibrated_um))
        own = faults(look, used)
        names.update(name for name, _ in own)
        print(
            f"  fold {k + 1}, {rows[-1][0]} poses left out: nominal {rows[-1][1]:.3f}, 24 DH parameters "
            f"{rows[-1][2]:.3f}, diagnosed {rows[-1][3]:.3f} mm rms; level {look.state.level:.2f}; "
            f"faults: {told(own)}; {time.perf_counter() - begin:.0f} s",
            flush=True,
        )
    weight = np.array([row[0] for row in rows])
    pooled = np.sqrt((weight[:, None] * np.array([row[1:] for row in rows]) ** 2).sum(axis=0) / weight.sum())
    print(f"  all folds: nominal {pooled[0]:.3f}, 24 DH parameters {pooled[1]:.3f}, diagnosed {pooled[2]:.3f} mm rms")
    print(f"  faults in folds: {', '.join(f'{name} {n}' for name, n in names.most_common()) or 'none'}")


def whole(rig: Rig, table: PoseTable, series: str, others: dict[str, PoseTable]) -> None:
    """From a whole series; the frozen models on the other series, set-up fitted: months apart."""
    begin = time.perf_counter()
    seen = observe_run(model_of(rig), table, f"series {series}")
    look = search([seen], lambda doing: None)
    print(f"  of the whole series, {time.perf_counter() - begin:.0f} s: faults {told(faults(look, seen))}")
    print(f"  a healthy arm's share of everything, at {look.state.level:.2f} times its size: "
          f"{told(shares_of(look)[:LISTED])}")  # fmt: skip
    plain = plain_of(seen)
    stages = stages_of(FittedRuns([seen]), look)
    for name, other in others.items():
        there = observe_run(model_of(rig), other, f"series {name}")
        plain_mm = plain.held_out_mm(ARM, seen_of(there), again=True)
        after = gap([in_own_setup(there, name)], stages, look, [name])
        print(
            f"  frozen, on series {name.upper()}, set-up fitted: nominal {1e-3 * after.before_um:.3f}, 24 DH "
            f"parameters {plain_mm:.3f}, diagnosed {1e-3 * after.calibrated_um:.3f} mm rms",
            flush=True,
        )


def draw(given: Namespace) -> Iterator[Namespace]:
    rig = load("ur10")[0]
    tables = {series: read(given.data / f"series_{series}.csv") for series in given.series.split(",")}
    yield from (Namespace(**vars(given) | {"series": series, "rig": rig, "tables": tables}) for series in tables)


def told_series(case: Namespace) -> str:
    """Every fold of a series, then the whole of it, line by line as they come."""
    table, others = case.tables[case.series], {name: one for name, one in case.tables.items() if name != case.series}
    judged(case.rig, table, case.series, case.folds, case.only)
    if not case.only:
        whole(case.rig, table, case.series, others)
    return ""


TRIAL = Trial(
    draw,
    told_series,
    options={
        "DATA": (DATA / "ipa-ur10", "the folder of series_b.csv and series_d.csv"),
        "series": ("b,d", "which of them (b,d)"),
        "folds": (5, "parts that the neighbourhoods are dealt to (5)"),
        "only": (0, "the first so many folds alone, and no whole series"),
    },
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
