from dataclasses import replace

import numpy as np
import pytest

from analysis.diagnosis.evidence.gather import prepare_runs
from analysis.diagnosis.evidence.observation import rms
from analysis.diagnosis.evidence.setups import fit_run_setups
from analysis.runs.loading import Measured
from analysis.runs.tables import PoseTable
from rigs.load import load
from tests.support.conventions import run_of
from tests.worlds.arms.independent_arm import Cell, Seen, bad_zeros, cell, healthy, postures

RIG = load("ur10e")[0]
TARGETS = np.array([[40.0, 0.0, 120.0], [-40.0, 30.0, 120.0], [0.0, -50.0, 150.0]])


def _run(seen: Seen, name: str, placement: str = "") -> Measured:
    run = run_of(PoseTable(seen.q, seen.xyz_mm, None), name, RIG)
    return replace(run, run=replace(run.run, manifest=run.run.manifest.model_copy(update={"placement": placement})))


def _cell(seed: int) -> tuple[Cell, np.random.Generator]:
    rng = np.random.default_rng(seed)
    return cell("ur10e", bad_zeros(rng) if seed % 2 else healthy(rng), rng), rng


def test_each_reflector_has_a_place_of_its_own():
    there, rng = _cell(1)
    q = postures("ur10e", 50, rng)
    seen = [replace(there, tool_mm=place).seen(q, rng) for place in TARGETS]
    seen.append(replace(there, tool_mm=TARGETS[1], place_mm=there.place_mm + 500).seen(seen[0].q, rng))
    runs = [_run(one, f"t{k}", f"p{k}") for k, one in enumerate(seen)]
    (kept,), said = prepare_runs(RIG, runs)
    placed, left = fit_run_setups(kept)
    alone = [rms(fit_run_setups([run])[1]) for run in kept]
    assert all(rms([one]) < 1.1 * each for one, each in zip(left, alone, strict=True))
    targets = np.array([placed[run.setup].T_tool_target[:3, 3] for run in kept])
    apart = np.linalg.norm(targets - targets[0], axis=1)
    truth = np.linalg.norm(TARGETS[[0, 1, 2, 1]] - TARGETS[0], axis=1)
    assert apart == pytest.approx(truth, abs=3.0) and targets[1] == pytest.approx(targets[3])
    (line,) = said
    assert "(t0; t1, t3; t2)" in line
    assert "and 4 places" in line


def test_one_reflector_is_one_set_up():
    there, rng = _cell(1)
    parts = np.array_split(postures("ur10e", 120, rng), 3)
    runs = [_run(there.seen(part, rng), f"s{k}") for k, part in enumerate(parts)]
    (kept,), said = prepare_runs(RIG, runs)
    assert {run.setup for run in kept} == {"pose"} and not said
