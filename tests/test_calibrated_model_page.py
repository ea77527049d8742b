import datetime as dt
import runpy
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from pydantic import TypeAdapter

from analysis.correction.model_files import write_extended
from analysis.correction.pose_uncertainty import PoseUncertainty
from analysis.correction.work import tool_poses
from analysis.robot.kinematics.arm import Array
from analysis.robot.predict import model_of
from rigs.calibration import CalibratedModel, CovarianceParameter, Term, packed_factor
from rigs.effects import AnyEffect, Effect
from rigs.load import load
from rigs.rig import Rig
from rigs.schema.effect import size_field

READER: dict[str, Any] = runpy.run_path(str(Path(__file__).parents[1] / "docs" / "calibration_reader.py"))

NAMED = yaml.safe_load("""
- {effect: transmission_error, axis: 2, order: 1.3, amplitude_deg: 0.03, phase_deg: 40, third: 0.2}
- {effect: compliance, axis: 3, deg_per_Nm: 0.0004, payload_kg: 3.5}
""")
TERMS = yaml.safe_load("""
- [{effect: joint_offset, axis: 3, offset_deg: 0.02}, 1.7]
- [{effect: joint_offset, axis: 3, offset_deg: 0.05}, -0.3]
- [{effect: link_geometry, axis: 3, field: a, delta: 0.2}, 2.1]
- [{effect: link_geometry, axis: 4, field: d, delta: 0.2}, -1.4]
- [{effect: link_geometry, axis: 5, field: alpha, delta: 0.02}, 3.0]
- [{effect: link_geometry, axis: 3, field: beta, delta: 0.02}, -2.2]
- [{effect: transmission_error, axis: 4, order: 2, amplitude_deg: 0.005}, 0.9]
- [{effect: transmission_error, axis: 4, order: 2, amplitude_deg: 0.005, phase_deg: 90}, -1.2]
- [{effect: transmission_error, axis: 1, order: 81, amplitude_deg: 0.005, third: 0.3}, 0.6]
- [{effect: compliance, axis: 2, deg_per_Nm: 0.00005, payload_kg: 5}, 1.1]
- [{effect: compliance, axis: 5, deg_per_Nm: 0.0003}, -0.4]
- [{effect: joint_scale, axis: 2, relative: 0.00005}, 1.3]
- [{effect: strain_wave, axis: 2, deg_per_Nm: 0.0001, knee_Nm: 40}, 1.3]
- [{effect: strain_wave, axis: 3, deg_per_Nm: 0.0001, knee_Nm: 5}, 2.3]
- [{effect: wrist_coupling, from_axis: 4, to_axis: 6, ratio: 0.0001}, 1.5]
- [{effect: link_bending, axis: 2, mm_per_Nm: 0.0001}, 2.5]
- [{effect: link_bending, axis: 3, mm_per_Nm: 0.0001}, 1.5]
- [{effect: base_yields, way: evenly, deg_per_Nm: 0.00001, below_mm: 300}, 1.5]
- [{effect: base_yields, way: yx, deg_per_Nm: 0.00001}, 2.5]
- [{effect: base_sags, way: y, mm_per_Nm: 0.0001}, -2.5]
""")
LEFT_OUT = yaml.safe_load("""
- [{effect: servo_lag, axis: 1, lag_s: 0.002}, 1.0]
- [{effect: gauge_scale, gauge: g1, relative: 0.001}, 1.0]
""")
"""Kinds of terms that the page's reader passes over."""
OTHERS = {
    "  payload_kg: 1\n": """\
  payload_kg: 1
  base: {xyz_mm: [100, -50, 400], rpy_deg: [10, -20, 30]}
  coupling:
    - [1, 0, 0, 0, 0, 0]
    - [0, 1, 0, 0, 0, 0]
    - [0, 1, 1, 0, 0, 0]
    - [0, 0, 0, 1, 0, 0]
    - [0, 0, 0, 0.02, 1, 0]
    - [0, 0, 0, 0.03, -0.1, 1]
""",
    "xyz_mm: [0, 0, 150]": "xyz_mm: [40, -30, 150]",
}
"""What the shipped UR10 has otherwise, so that every number of a rig file's arm counts."""
Q = np.random.default_rng(7).uniform(-2.0, 2.0, (25, 6))


def calibrated(named: list[Effect], terms: list[tuple[Effect, float]]) -> CalibratedModel:
    every = [Term(effect=one, times=1.0, named=True) for one in named]
    every += [Term(effect=one, times=times) for one, times in terms]
    parameters = [CovarianceParameter(term=k, field=size_field(one)) for k, one in enumerate(named)]
    parameters += [CovarianceParameter(term=len(named) + k, field="times") for k in range(len(terms))]
    sd = [*(0.1 * float(getattr(one, size_field(one))) for one in named), *(0.3 for _ in terms)]
    root = np.tril(np.random.default_rng(3).uniform(-0.3, 0.3, (len(sd), len(sd))), -1) + np.eye(len(sd))
    return CalibratedModel(
        rig="ur10", date=dt.date(2026, 1, 1), version="0", runs=(), joints_deg=((-180.0, 180.0),) * 6, setups={},
        before_um=900.0, calibrated_um=90.0, terms=tuple(every),
        parameters=tuple(parameters), factor=packed_factor(np.array(sd)[:, None] * root),
    )  # fmt: skip


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A rig file with its calibration beside it, of an arm on a slope with coupled axes."""
    of_row: Callable[[Any], Effect] = TypeAdapter(AnyEffect).validate_python
    named = [of_row(row) for row in NAMED]
    terms = [(of_row(row), times) for row, times in [*TERMS, *LEFT_OUT]]
    text = load("ur10-cell")[1]
    for old, new in OTHERS.items():
        assert text.count(old) == 1
        text = text.replace(old, new)
    return write_extended(text, named, tmp_path_factory.mktemp("calibrated") / "cell.yaml", calibrated(named, terms))[
        -1
    ]


@pytest.fixture
def rig(written):
    return load(written)[0]


@pytest.fixture
def read(written):
    reader: Callable[[Path], Any] = READER["read"]
    return reader(written)


def ours(rig: Rig) -> Array:
    by_posture = [one for one in model_of(rig).effects if one.compensation().use != "none"]
    return tool_poses(model_of(rig, by_posture), Q)


def test_the_reader_of_the_page_gives_the_tool_poses_of_analysis(rig, read):
    arm, effects, _ = read
    theirs = np.array([READER["tool"](arm, effects, q) for q in Q])
    assert theirs[:, :3, 3] == pytest.approx(ours(rig)[:, :3, 3], rel=0, abs=1e-9)  # mm
    assert theirs[:, :3, :3] == pytest.approx(ours(rig)[:, :3, :3], rel=0, abs=1e-12)


@pytest.mark.parametrize("k", range(len(TERMS)))
def test_every_kind_of_term_moves_the_tool(k, read):
    arm, effects, _ = read
    others = effects[: len(NAMED) + k] + effects[len(NAMED) + k + 1 :]
    moved = [READER["tool"](arm, effects, q) - READER["tool"](arm, others, q) for q in Q[:5]]
    assert np.abs(moved).max() > 1e-6


def test_the_uncertainty_of_the_place_is_that_of_corrected_targets(rig, read):
    assert rig.calibrated
    moves = PoseUncertainty(rig, rig.calibrated).pose_displacements(Q[:5])[:, :, :3]
    theirs = [READER["u_of_place"](*read, q) for q in Q[:5]]
    assert theirs == pytest.approx(np.sqrt((moves**2).sum(axis=(0, 2))), rel=2e-3)
