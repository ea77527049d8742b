"""Observations: a gauge errs by the place on its scale at which it was read, whatever the model lacks."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.fitting.observation import observe, predicted, thinned
from analysis.model.predict import model_of, nominal_setup
from analysis.simulation.simulate import simulate
from analysis.traces.tables import CircleTable
from rigs.effects import GaugeCyclic, LinkGeometry
from rigs.load import load

RIG = load("paper-fanuc")[0].model_copy(update={"effects": ()})
LACKED = LinkGeometry(axis=3, field="d", delta=0.4)
"""It moves the gauges by several tenths of a millimetre, and the model of these tests does not have it."""


@pytest.mark.parametrize("most", [10_000, 400])
def test_the_error_of_a_scale_is_found_where_the_gauge_was_read(most: int) -> None:
    cyclic = GaugeCyclic(gauge="g2", period_mm=0.2, amplitude_mm=0.01, phase_deg=40)
    sound = simulate(RIG, "yaw", "acw", None, (LACKED,))
    table = simulate(RIG, "yaw", "acw", None, (LACKED, cyclic))
    assert isinstance(sound, CircleTable)
    assert isinstance(table, CircleTable)
    planted = table.g_mm - sound.g_mm
    whole = observe(model_of(RIG), table, "yaw")
    one = thinned(whole, most) if len(whole.rows) > most else whole
    setup = nominal_setup(RIG, table)

    found = predicted(model_of(RIG, [cyclic]), one, setup) - predicted(model_of(RIG), one, setup)

    rows = np.searchsorted(table.t_s, one.path.t_s[one.path.rows[one.rows]])
    assert np.abs(sound.g_mm - simulate(RIG, "yaw", "acw", None).g_mm).max() > cyclic.period_mm  # type: ignore[union-attr]
    np.testing.assert_allclose(found, planted[rows], atol=1e-4)
    assert np.abs(planted).max() > 0.009


def test_a_long_wave_of_a_scale_does_not_follow_what_the_model_lacks() -> None:
    """The lap is as it was read beside a model without its error of 0.4 mm. A wave of 2 mm of what was read would
    take up a part of that error in proportion to its size."""
    table = simulate(RIG, "yaw", "acw", None, (LACKED,))
    assert isinstance(table, CircleTable)
    one, setup = observe(model_of(RIG), table, "yaw"), nominal_setup(RIG, table)
    long = GaugeCyclic(gauge="g2", period_mm=2.0, amplitude_mm=0.05)

    found = predicted(model_of(RIG, [long]), one, setup) - predicted(model_of(RIG), one, setup)

    as_read = 0.05 * np.sin(2 * np.pi * one.values[:, 1] / 2.0)
    assert np.abs(found[:, 1] - as_read).max() > 0.01
