import math
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from analysis.apps.emulate.robot import Trace, target_trace, trace
from analysis.procedures.results import result_of
from analysis.runs.loading import measured_of
from analysis.runs.noise.certificate import (
    as_shown,
    beyond_certificates,
    corrected,
    corrected_gauges,
    link_excess_mm,
    systematic,
)
from analysis.runs.tables import CircleTable
from daq.protocol.conversation import Sample
from daq.store import Run, read_run
from rigs.load import load, parse
from rigs.rig import Rig
from rigs.schema.probe import GaugeCertificate, Temperature
from rigs.schema.vocabulary import Direction, TestName
from tests.support.written_runs import recorded_run, write_simulated

PLAIN: dict[str, Any] = {"number": "D-K-1 2025-17", "date": "2025-03-01", "u_mm": 0.0008, "k": 2}
POLYNOMIAL = PLAIN | {"polynomial_mm": [0.001, -0.002, 0.0003, 2e-5], "range_mm": [-12, 12]}
TABLE = PLAIN | {"correction_mm": [[-12, 0.02], [-3, -0.004], [0, 0], [5, 0.009], [12, -0.03]]}


def test_a_gauge_wrong_by_a_known_polynomial_is_put_right():
    """The error is planted from the lengths, by Newton's method, without the module's own inverse."""
    rng = np.random.default_rng(1)
    length_mm = rng.uniform(-11, 11, 500)
    c0, c1, c2, c3 = POLYNOMIAL["polynomial_mm"]
    shown_mm = length_mm.copy()
    for _ in range(20):
        off = shown_mm + c0 + c1 * shown_mm + c2 * shown_mm**2 + c3 * shown_mm**3 - length_mm
        shown_mm -= off / (1 + c1 + 2 * c2 * shown_mm + 3 * c3 * shown_mm**2)
    assert np.abs(shown_mm - length_mm).max() > 0.03
    assert corrected(GaugeCertificate(**POLYNOMIAL), shown_mm, None) == pytest.approx(length_mm, abs=1e-12)


def test_a_table_is_straight_between_its_readings_and_level_beyond_them():
    found = corrected(GaugeCertificate(**TABLE), np.array([-20.0, -12, -7.5, 0, 2.5, 13]), None)
    assert found == pytest.approx([-19.98, -11.98, -7.492, 0, 2.5045, 12.97])


@pytest.mark.parametrize("certificate", [PLAIN, TABLE, POLYNOMIAL], ids=["none", "table", "polynomial"])
@given(length_mm=st.floats(-15, 15), warm_c=st.floats(-10, 40))
def test_showing_and_correcting_undo_each_other(certificate, length_mm, warm_c):
    one = GaugeCertificate(**certificate, coefficient_per_c=1e-5)
    warm = Temperature(mean_c=warm_c, u_c=1)
    assert corrected(one, as_shown(one, np.array(length_mm), warm), warm) == pytest.approx(length_mm, abs=1e-6)


def test_a_warm_gauge_reads_short():
    one = GaugeCertificate(**PLAIN, coefficient_per_c=11.5e-6)
    found = corrected(one, np.array([10.0]), Temperature(mean_c=30, u_c=0.5))
    assert found == pytest.approx([10 + 10 * 11.5e-6 * 10], abs=1e-12)


def test_readings_beyond_the_range_are_counted_of_each_gauge():
    rig = _rig(g1=TABLE, g2=PLAIN)
    g_mm = np.array([[-13.0, 40.0], [12.0, 40.0], [12.01, -40.0]])
    found, beyond = corrected_gauges(rig, ["g1", "g2"], g_mm)
    doubts = beyond_certificates(rig, beyond, len(g_mm))
    (doubt,) = doubts
    assert doubt.startswith("g1: 2 of 3 ") and "-12 to 12 mm" in doubt and "D-K-1 2025-17" in doubt
    assert found[:, 1].tolist() == g_mm[:, 1].tolist() and found[1, 0] == pytest.approx(11.97)


def test_uncertainty_of_certificates():
    ball = PLAIN | {"form_mm": 0.004, "u_mm": 0.001, "k": 2}
    link = PLAIN | {"length_mm": 400.02, "u_mm": 0.006, "k": 3, "coefficient_per_c": 1e-5}
    rig = _rig(g1=TABLE, ball=ball, link=link, temperature={"mean_c": 22, "u_c": 0.5})
    found = systematic(rig, np.array([[1.0, 2.0], [-3.0, 1.0]]))
    assert found.gauge_mm == pytest.approx((0.0004, 0.0))
    assert found.ball_mm == pytest.approx(math.hypot(0.004 / math.sqrt(8), 0.0005))
    assert found.link_mm == pytest.approx(math.hypot(0.002, 400.02 * 1e-5 * 0.5))
    assert link_excess_mm(rig) == pytest.approx(400.02 * (1 + 2e-5) - 400)


def test_recorded_lap_is_stored_raw_and_corrected_at_analysis(tmp_path):
    data = yaml.safe_load(_text(g1=POLYNOMIAL, g2=TABLE, eccentricity=(0.6, -0.4, 0.1)))
    data["gauges"]["g1"]["counts"], data["gauges"]["g2"]["counts"] = "away", "towards"
    text = yaml.safe_dump(data)
    rig = parse(text, "certified")
    plain = trace(rig, "acw")
    assert any(np.ptp(column) > 1 for column in plain.g_mm.T)
    shown = _shown(rig, plain.g_mm)
    run = read_run(_recorded(tmp_path, text, "yaw", "acw", plain, shown))
    raw = np.stack([run.streams[name][f"{name}_mm"] for name in ("g1", "g2")], axis=1)
    measured = measured_of(run)
    at_s = np.arange(len(raw)) * 0.02
    assert raw[:, 0].tolist() == np.interp(at_s, plain.t_s, shown[:, 0]).tolist()
    assert np.abs(shown - plain.g_mm).max() > 1e-3
    assert np.abs(measured.table.g_mm - _at(plain.t_s, plain.g_mm, measured.table)).max() < 2e-6
    assert measured.systematic.gauge_mm == pytest.approx((0.0004, 0.0004))


def test_link_and_gauge_enter_the_sphere(tmp_path):
    link = PLAIN | {"length_mm": 400.25, "u_mm": 0.03, "k": 2}
    text = _text(g1=TABLE, link=link, step_deg=45, orientations=1)
    rig = parse(text, "certified")
    stops = target_trace(rig, "radial")
    path = _recorded(tmp_path, text, "radial", None, stops, _shown(rig, stops.g_mm))
    result = result_of(measured_of(read_run(path)))
    for name in ("radius_mm", "held_radius_mm"):
        assert result.figures[name].value == pytest.approx(400, abs=1e-3)
        assert result.figures[name].u == pytest.approx(0.015, rel=0.15)
    assert result.figures["ap_mm"].value < 0.02
    without = result_of(measured_of(_edited(read_run(path), rig_text=_text(g1=TABLE, step_deg=45, orientations=1))))
    assert without.figures["radius_mm"].value == pytest.approx(399.75, abs=1e-3)
    assert without.figures["radius_mm"].u < 0.005


def test_overdue_certificate_is_a_doubt(tmp_path):
    old = PLAIN | {"date": "2020-01-31", "interval_months": 13}
    ball = PLAIN | {"date": "2020-01-31", "valid_until": "2100-01-01", "form_mm": 0.001}
    run = _lap(tmp_path, _text(g1=old, ball=ball, link=old | {"length_mm": 400}))
    (doubt,) = [doubt for doubt in measured_of(run).doubts if "certificate" in doubt]
    assert re.match(r"g1: .*D-K-1 2025-17 .*2021-02-28.* \d{4}-\d\d-\d\d;", doubt)
    (doubt,) = [doubt for doubt in measured_of(_edited(run, started="yesterday")).doubts if "day" in doubt]
    assert "'yesterday'" in doubt


@pytest.mark.parametrize(("test", "direction", "of_link"), [("yaw", "acw", False), ("radial", None, True)])
def test_imported_table_is_assumed_corrected_with_a_doubt(tmp_path, test, direction, of_link):
    text = _text(g1=TABLE, g2=PLAIN, link=PLAIN | {"length_mm": 400.25}, step_deg=45, orientations=1)
    rig = parse(text, "certified")
    (path,) = write_simulated(rig, text, test, (direction,), [1], tmp_path)
    simulated = read_run(path)
    assert not any("assumed" in doubt for doubt in measured_of(simulated).doubts)
    source = simulated.manifest.table.model_copy(update={"file": "lap.csv"})
    imported = replace(simulated, manifest=simulated.manifest.model_copy(update={"table": source}))
    (doubt,) = [doubt for doubt in measured_of(imported).doubts if "assumed" in doubt]
    assert "g1 by certificate D-K-1 2025-17" in doubt and "g2" not in doubt
    assert ("+0.2500 mm" in doubt) == of_link


def _rig(**certificates: Any) -> Rig:
    return parse(_text(**certificates), "certified")


def _text(
    *,
    g1: dict[str, Any] | None = None,
    g2: dict[str, Any] | None = None,
    eccentricity: tuple[float, float, float] = (0, 0, 0),
    step_deg: float = 30,
    orientations: int = 3,
    **more: Any,
) -> str:
    """The UR10e with certificates, gauges without clocks of their own."""
    data = yaml.safe_load(load("ur10e-cell")[1])
    for number, (name, certificate) in enumerate((("g1", g1), ("g2", g2))):
        port = {"port": f"tcp://127.0.0.1:{502 + number}", "clock_s": None, "clock_us": None}
        data["gauges"][name] |= port | ({"certificate": certificate} if certificate else {})
    data["tests"]["circle"] |= {"eccentricity_mm": list(eccentricity), "speed_mm_s": 100}
    data["tests"]["hemisphere"] |= {"step_deg": step_deg, "orientations": orientations}
    return yaml.safe_dump(data | more)


def _lap(runs: Path, text: str) -> Run:
    driven = trace(parse(text, "certified"), "acw")
    return read_run(_recorded(runs, text, "yaw", "acw", driven, driven.g_mm))


def _edited(run: Run, **words: str) -> Run:
    return replace(run, manifest=run.manifest.model_copy(update=words))


def _shown(rig: Rig, g_mm: np.ndarray) -> np.ndarray:
    shown = g_mm.copy()
    for column, (_, gauge) in enumerate(rig.gauges):
        shown[:, column] *= gauge.sign
        if gauge.certificate:
            shown[:, column] = as_shown(gauge.certificate, shown[:, column], rig.temperature)
    return shown


def _at(t_s: np.ndarray, g_mm: np.ndarray, table: CircleTable) -> np.ndarray:
    begin = t_s[np.argmin(np.abs(g_mm[:, None, 0] - table.g_mm[None, :1, 0]))]
    shifts = begin + np.linspace(-0.05, 0.05, 2001)
    tries = [np.stack([np.interp(table.t_s + one, t_s, column) for column in g_mm.T], axis=1) for one in shifts]
    return min(tries, key=lambda tried: float(np.abs(tried - table.g_mm).max()))


def _recorded(
    runs: Path, text: str, test: TestName, direction: Direction | None, driven: Trace, g_mm: np.ndarray
) -> Path:
    """A run as rigd writes it: every 20 ms a reading of each gauge and the joints, all at one instant."""

    def samples() -> Iterator[tuple[str, Sample]]:
        for at_s in np.arange(0.0, driven.t_s[-1], 0.02):
            ns = int((5 + at_s) * 1e9)
            for gauge, column in zip(("g1", "g2"), g_mm.T, strict=True):
                reading = float(np.interp(at_s, driven.t_s, column))
                yield gauge, Sample((reading,), ns - 1000, ns + 1000, ns + 1000, 31)
            joints = tuple(float(np.degrees(np.interp(at_s, driven.t_s, joint))) for joint in driven.q.T)
            yield "robot", Sample(joints, ns, ns, ns, 63, 1000 + at_s)

    return recorded_run(runs, text, test, direction, samples())
