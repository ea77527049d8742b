import re
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.interpolate import CubicSpline

from rigs.load import load
from rigs.schema.condition import CURRENTS
from tests.support.changed_rigs import shipped
from tests.support.command_line import ran
from tests.support.store_cases import edit_manifest
from tests.support.table_cases import RIG_FILE, circle_values
from tests.support.written_runs import lap_samples, recorded_run

COULOMB_A = np.array([0.8, 0.9, 0.6, 0.3, 0.3, 0.3])
BEGAN = datetime(2026, 5, 1, 9, tzinfo=UTC)


def recorded(folder: Path, day: int, third_a: float) -> None:
    """A run whose motors carry gravity, as a slow wave, and friction; that of joint 3 takes `third_a`."""
    rng = np.random.default_rng(day)
    t_s, q, g_mm = circle_values("yaw", "acw")
    coarse_s, t_s = t_s, np.arange(0, t_s[-1], 0.01)
    q, g_mm = (CubicSpline(coarse_s, values)(t_s) for values in (q, g_mm))
    speed = np.gradient(q, t_s, axis=0)
    friction = COULOMB_A.copy()
    friction[2] = third_a
    current = friction * np.sign(speed) + 2 * speed + 3 * np.cos(2 * q + [0, 1, 2, 3, 4, 5])
    current += rng.normal(0, 0.05, current.shape)
    run = recorded_run(folder, load(RIG_FILE)[1], "yaw", "acw", lap_samples(t_s, q, g_mm, current), CURRENTS)
    edit_manifest(run, {"started": (BEGAN + timedelta(days=day)).isoformat(), "rig_name": RIG_FILE})


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs")
    for day in range(10):
        recorded(folder, day, 0.6 if day < 5 else 0.75)
    return folder


def test_a_joint_whose_friction_grew_is_named_and_no_other(runs):
    shown = " ".join(ran(f"history {RIG_FILE} --runs {runs}").stdout.split())
    assert re.search("axis 3 rose from 0.6.* A between 5 and 6 May 2026", shown)
    assert shown.count(" rose from ") == 1, shown


def test_a_limit_of_friction_is_one_like_any_other(runs, tmp_path):
    limited = tmp_path / "limited.yaml"
    limited.write_text(yaml.safe_dump(shipped(RIG_FILE) | {"limits": {"yaw": {"friction_j3_a": 0.7}}}))
    shown = " ".join(ran(f"history {RIG_FILE} --runs {runs} --rig {limited}").stdout.split())
    assert re.search("axis 3 .* 0.7 A since 6 May 2026", shown)
