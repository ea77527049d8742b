import numpy as np

from analysis.procedures import radial
from tests.worlds.planted import targets
from tests.worlds.planted.targets import Stops

COARSE = Stops(scatter_mm=(0.002, 0.002), white_mm=0.0003, step_mm=0.010)


def test_uncertainties_include_the_step_of_a_coarse_gauge():
    within: dict[str, list[bool]] = {}
    for seed in range(30):
        rng = np.random.default_rng(seed)
        expected = targets.draw_errors(rng)
        twice = np.tile(expected, 2)
        g_mm = targets.read(rng, COARSE, targets.scattered(rng, COARSE, twice, np.full(len(twice), 0.002)))
        found = radial.evaluate(targets.visited(2, g_mm), 400.0, 0.0005, orientations=3)
        assert any(note.startswith("readings step by 10 µm") for note in found.notes)
        for name, value in targets.true_radial(expected).items():
            within.setdefault(name, []).append(abs(found.figures[name].value - value) <= 2 * found.figures[name].u)
    assert {name: float(np.mean(held)) >= 0.85 for name, held in within.items()} == dict.fromkeys(within, True)
