from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.procedures.circle import CircleResult
from analysis.procedures.results import with_certificates
from analysis.procedures.shared.quantity import Quantity
from analysis.procedures.shared.test_kind import evaluate
from analysis.procedures.simulate import simulate
from analysis.runs.noise.certificate import NO_CERTIFICATE, Systematic
from analysis.runs.tables import CircleTable, RadialTable, RepeatabilityTable
from rigs.load import load, load_hidden
from rigs.rig import Rig
from rigs.schema.vocabulary import CIRCLES, TestName
from tests.support.nightly import cases

U_MM = 0.001
DRAWS = 20
Table = CircleTable | RadialTable | RepeatabilityTable


def _figures(table: Table, rig: Rig) -> dict[str, Quantity]:
    found = evaluate(table, rig, 0.0, "run")
    figures = dict(found.figures)
    if isinstance(found, CircleResult):
        distance = found.distance.figures
        figures |= {f"distance_{name}" if name in figures else name: one for name, one in distance.items()}
    return figures


def _errors(table: Table, rig: Rig, wave_mm: float, rng: np.random.Generator) -> dict[str, float]:
    """Root mean square error of each figure where each gauge is wrong by a sine of sd U_MM, its phase unknown."""
    plain = _figures(table, rig)
    off: dict[str, list[float]] = {name: [] for name in plain}
    for _ in range(DRAWS):
        phase = rng.uniform(0, 2 * np.pi, table.g_mm.shape[-1] if table.g_mm.ndim == 2 else 1)
        wrong = table.g_mm + np.sqrt(2) * U_MM * np.sin(2 * np.pi * table.g_mm / wave_mm + phase)
        for name, figure in _figures(replace(table, g_mm=wrong), rig).items():
            change = figure.value - plain[name].value
            off[name].append((change + 180) % 360 - 180 if name == "shift_deg" else change)
    return {name: float(np.sqrt(np.mean(np.square(changes)))) for name, changes in off.items()}


@pytest.mark.parametrize(
    ("name", "test"),
    cases(
        [
            ("paper-fanuc", "yaw"),
            ("ur10e", "yaw"),
            ("ur10e", "roll"),
            ("ur10e", "radial"),
            ("paper-fanuc", "repeatability"),
        ],
        [("ur10e", "yaw"), ("ur10e", "radial")],
    ),
)
def test_certificate_u_covers_an_unknown_gauge_error(name: str, test: TestName) -> None:
    rig = load_hidden(name).apply_to(load(name)[0])
    table = simulate(rig, test, "acw" if test in CIRCLES else None, 3 if test == "repeatability" else None)
    assert not hasattr(table, "xyz_mm")
    gauges = (U_MM, U_MM) if test in CIRCLES else (U_MM,)
    without = {figure: replace(one, u=0.0) for figure, one in _figures(table, rig).items()}  # type: ignore[arg-type]
    stated = with_certificates(without, Systematic(gauges), rig, test)
    rng = np.random.default_rng(4)
    tries = [_errors(table, rig, wave_mm, rng) for wave_mm in (2.5, 5, 20)]  # type: ignore[arg-type]
    for figure, one in stated.items():
        worst = max(errors[figure] for errors in tries)
        if not figure.endswith("_at_deg"):
            assert worst < 1.5 * one.u + 1e-9, figure  # of the worst wave, by 20 draws
    main = {"yaw": "offset_deg", "roll": "offset_deg", "radial": "radius_mm", "repeatability": "bi_mm"}[test]
    assert max(errors[main] for errors in tries) > 0.3 * stated[main].u  # wide u covers and says nothing


def test_without_certificates_nothing_changes_and_ball_and_link_enter_where_they_count() -> None:
    rig, _ = load("ur10e")
    names = ("radius_mm", "ap_mm", "centre_x_mm", "spread_mm")
    figures = {name: Quantity(1.0, 0.003, "mm") for name in names}
    assert with_certificates(figures, NO_CERTIFICATE, rig, "radial") is figures
    found = with_certificates(figures, Systematic((0.0,), 0.001, 0.004), rig, "radial")
    assert found["radius_mm"].u == found["ap_mm"].u == pytest.approx(np.sqrt(9 + 16 + 1) / 1000)
    assert found["centre_x_mm"].u == pytest.approx(np.sqrt(9 + 2) / 1000)
    assert found["spread_mm"].u == 0.003  # at one target the link touches the ball at one place
