"""The diagnosis engine on simulated runs: the hidden effect is named with its size, a healthy robot draws no name."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.diagnose.blocks import Block, blocks_of
from analysis.diagnose.candidates import candidates_for
from analysis.diagnose.response import Response
from analysis.diagnose.search import Explained, Search
from analysis.fitting.estimate import fit
from analysis.fitting.observation import observe
from analysis.model.predict import model_of
from analysis.model.simulate import simulate
from rigs.effects import Backlash, Effect, JointOffset, TransmissionError, size_field
from rigs.load import load

RIG = load("paper-fanuc")[0].model_copy(update={"effects": ()})


def _blocks(truth: tuple[Effect, ...], seed: int) -> tuple[Response, list[Block]]:
    seeds = iter(range(100 * seed, 100 * seed + 99))
    tables = [
        simulate(RIG, test, direction, next(seeds), truth)
        for test in ("yaw", "roll")
        for direction in ("cw", "acw")
        for _ in range(4)
    ]
    tables.append(simulate(RIG, "radial", None, next(seeds), truth))
    model = model_of(RIG)
    observations = [observe(model, table, "simulated") for table in tables]
    fitted = fit(model, observations)
    blocks, repeated = blocks_of(model, observations, fitted)
    assert repeated and {block.count for block in blocks} == {1, 4}
    return Response(model, blocks, fitted), blocks


def _explained(truth: tuple[Effect, ...], seed: int) -> Explained:
    response, blocks = _blocks(truth, seed)
    return Search(response, candidates_for(response.model, blocks)).explain()


@pytest.mark.parametrize("seed", [4, 5])
def test_a_healthy_robot_draws_no_name_and_its_noise_is_white(seed: int) -> None:
    response, blocks = _blocks((), seed)
    assert np.mean(response.y**2) == pytest.approx(1.0, abs=0.1)
    assert Search(response, candidates_for(response.model, blocks)).explain().names == ()


@pytest.mark.timeout(300)
@pytest.mark.parametrize(
    ("truth", "name"),
    [
        (Backlash(axis=1, width_deg=0.05), "backlash 1"),
        (JointOffset(axis=3, offset_deg=0.2), "joint_offset 3"),
        (TransmissionError(axis=4, order=2, amplitude_deg=0.05, phase_deg=40), "transmission_error 4 order 2"),
    ],
)
def test_a_hidden_effect_is_named_with_its_size(truth: Effect, name: str) -> None:
    found = _explained((truth,), 3)
    assert found.names == (name,)
    field = size_field(truth)
    assert getattr(found.refined.effects[0], field) == pytest.approx(getattr(truth, field), rel=0.05)
    assert found.posterior[0] > 0.5, found.rivals
