import dataclasses

import numpy as np
import pytest

from analysis.procedures import radial, repeatability
from analysis.procedures.shared.quantity import Quantity
from analysis.runs.tables import RepeatabilityTable
from tests.worlds.planted import targets
from tests.worlds.planted.targets import STOP_S, Stops

COARSE = Stops(scatter_mm=(0.002, 0.002), white_mm=0.0003, step_mm=0.010)
CELLS = 100
NOTE = "readings step by 10 µm, more than they scatter"


def _radial_case(rng: np.random.Generator) -> tuple[dict[str, Quantity], dict[str, float], tuple[str, ...]]:
    expected = targets.draw_errors(rng)
    twice = np.tile(expected, 2)
    g_mm = targets.read(rng, COARSE, targets.scattered(rng, COARSE, twice, np.full(len(twice), COARSE.scatter_mm[0])))
    found = radial.evaluate(targets.visited(2, g_mm), 400.0, 0.0005, orientations=3)
    return found.figures, targets.true_radial(expected), found.notes


def _repeatability_case(rng: np.random.Generator) -> tuple[dict[str, Quantity], dict[str, float], tuple[str, ...]]:
    """Its truth is what a gauge without steps would show on average."""
    by_round = (targets.TARGETS, 3, 2)
    reversal = rng.uniform(0.02, 1.4, (targets.TARGETS, 1, 1)) * np.array([-0.5, 0.5])
    expected = np.broadcast_to(reversal + rng.uniform(0, 0.01, (targets.TARGETS, 1, 1)), by_round).ravel()
    sigma = np.full(len(expected), COARSE.scatter_mm[0])
    g_mm = targets.read(rng, COARSE, targets.scattered(rng, COARSE, expected, sigma))
    again = targets.done_again(rng, dataclasses.replace(COARSE, step_mm=1e-7), expected, sigma)
    truth = targets.repeatability_figures(again.reshape(-1, *by_round).swapaxes(-1, -2))
    target, round_, side = (index.ravel() for index in np.indices(by_round))
    time_s, q = STOP_S * np.arange(len(g_mm)), np.zeros((len(g_mm), 6))
    approach = np.array(targets.SIDES)[side]
    found = repeatability.evaluate(RepeatabilityTable(target + 1, approach, round_ + 1, time_s, q, g_mm), 0.0005)
    return found.figures, {name: float(values.mean()) for name, values in truth.items()}, found.notes


@pytest.mark.parametrize("case", [_radial_case, _repeatability_case])
def test_a_coarse_gauge_is_seen_and_in_every_uncertainty(case):
    within: dict[str, list[bool]] = {}
    for seed in range(CELLS):
        figures, truth, notes = case(np.random.default_rng(seed))
        assert any(note.startswith(NOTE) for note in notes)
        for name, value in truth.items():
            within.setdefault(name, []).append(abs(figures[name].value - value) <= 2 * figures[name].u)
    shares = {name: float(np.mean(held)) for name, held in within.items()}
    assert min(shares.values()) >= 0.9, shares
