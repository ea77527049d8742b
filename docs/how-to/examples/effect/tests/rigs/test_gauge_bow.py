"""The bow of a gauge against its closed form."""

import numpy as np
import pytest

from analysis.procedures.simulate import simulate
from analysis.runs.tables import CircleTable
from rigs.effects import GaugeBow
from rigs.load import load, load_hidden


def test_a_bow_adds_the_square_of_the_reading_to_its_own_gauge() -> None:
    rig = load_hidden("paper-fanuc").apply_to(load("paper-fanuc")[0])  # its ball is off the centre of the circle
    bow = GaugeBow(gauge="g1", relative_per_mm=0.05)
    sound, bent = (simulate(rig, "yaw", "cw", None, effects) for effects in ((), (bow,)))
    assert isinstance(sound, CircleTable) and isinstance(bent, CircleTable)
    g1_mm, g2_mm = sound.g_mm.T
    assert np.abs(g1_mm).max() > 0.1
    assert bent.g_mm[:, 0] == pytest.approx(g1_mm + 0.05 * g1_mm**2)
    assert bent.g_mm[:, 1] == pytest.approx(g2_mm)
