import math

import numpy as np
import pytest

from analysis.apps.plant.records import record_of
from analysis.runs.loading import measured_of
from analysis.runs.robot_condition import condition_of
from daq.store import read_run
from rigs.load import load
from rigs.schema.condition import TEMPERATURES, UNDISTURBED, ProgramState, SafetyState
from tests.support.table_cases import JOINTS, RIG_FILE, circle_values
from tests.support.written_runs import lap_samples, recorded_run

HZ = 10


def robot(**changed: tuple[float, float, float]) -> dict[str, np.ndarray]:
    """Return columns of 100 s: joint 1 rests until 20 s, moves until 80 s and rests again. changed: from, until,
    value.
    """
    t_s = np.arange(0, 100, 1 / HZ)
    q_deg = np.interp(t_s, [20, 80], [10.0, 70.0])
    columns = {"last_byte_ns": (5e9 + t_s * 1e9).astype(np.int64)}
    columns |= {name: q_deg * (name == "q1_deg") for name in JOINTS}
    columns |= {name: np.full(len(t_s), value) for name, value in UNDISTURBED.items()}
    for name, (begin_s, end_s, value) in changed.items():
        columns[name][(t_s >= begin_s) & (t_s < end_s)] = value
    return columns


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"safety_state": (40, 43, SafetyState.PROTECTIVE_STOP)}, "stop from 40.0 s"),
        ({"safety_state": (90, 100, SafetyState.EMERGENCY_STOP)}, "stop from 90.0 s"),
        ({"program_state": (50, 58.5, ProgramState.PAUSED)}, "paused from 50.0 s on for 8.5 s"),
        ({"program_state": (0, 100, ProgramState.STOPPED)}, "moved without a program, from 20"),
        ({"program_state": (50, 60, ProgramState.STOPPED)}, "run from 50.0 s on for 10.0 s"),
        ({"motors_on": (79, 90, 0)}, "off from 79.0 s on for 1."),
        ({"program_state": (90, 100, ProgramState.PAUSED)}, "last motion"),
        ({"speed_percent": (0, 100, 40)}, "speed was 40 % throughout; compare only"),
        ({"speed_percent": (60, 61, 97)}, "97 % from 60.0 s on for 1.0 s"),
    ],
)
def test_disturbance_is_a_doubt(changed, says):
    (doubt,) = condition_of(robot(**changed)).doubts
    assert says in doubt, doubt


@pytest.mark.parametrize(
    "changed",
    [
        {"safety_state": (0, 15, SafetyState.PROTECTIVE_STOP)},
        {"safety_state": (0, 100, SafetyState.REDUCED)},
        {"safety_state": (0, 100, math.nan)},
        {"program_state": (0, 15, ProgramState.PAUSED)},
        {"program_state": (85, 100, ProgramState.STOPPED)},
        {"program_state": (0, 100, 77)},
        {"motors_on": (85, 100, 0)},
        {"speed_percent": (85, 100, 0)},
        {"speed_percent": (0, 100, 99.8)},
        {"program_state": (82, 100, ProgramState.STOPPED), "safety_state": (90, 95, SafetyState.SAFEGUARD_STOP)},
    ],
)
def test_harmless_condition_is_no_doubt(changed):
    assert condition_of(robot(**changed)).doubts == ()


def test_mean_and_rise_of_a_joints_temperature():
    columns = robot()
    columns["temperature2_c"] = np.linspace(30.0, 40.0, len(columns["last_byte_ns"]))
    columns["temperature3_c"] = np.full(len(columns["last_byte_ns"]), math.nan)
    warmth = condition_of(columns).warmth
    assert sorted(warmth) == [1, 2, 4, 5, 6]
    assert (warmth[2].mean_c, warmth[2].rise_c) == pytest.approx((35.0, 9.0), abs=0.05)
    assert warmth[1].rise_c == 0 and warmth[1].u_mean_c == 0


def test_doubt_of_a_recorded_run_and_its_temperatures_are_stored(tmp_path):
    t_s, q, g_mm = circle_values("yaw", "acw")
    k = np.arange(len(t_s))
    safety = np.where((k > 40) & (k < 60), SafetyState.PROTECTIVE_STOP, SafetyState.NORMAL)
    more = np.column_stack([safety, *[30.0 + 5 * k / len(t_s)] * 6])
    samples = lap_samples(t_s, q, g_mm, more)
    run = read_run(recorded_run(tmp_path, load(RIG_FILE)[1], "yaw", "acw", samples, ("safety_state", *TEMPERATURES)))
    (doubt,) = measured_of(run).doubts
    assert "protective stop" in doubt
    record = record_of(run.path, run.manifest, "f")
    assert not record.problem
    assert str(record.figures["temperature_j4_c"]).endswith("°C")
    assert record.figures["warming_j4_c"].value == pytest.approx(4.5, abs=0.2)
