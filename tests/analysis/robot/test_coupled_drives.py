from dataclasses import replace

import numpy as np
import pytest

from analysis.procedures.shared.test_kind import path_of
from analysis.robot.kinematics.arm import arm_of, drive_angles, reported_angles
from analysis.robot.predict import geometric_arm, model_of, moved
from analysis.runs.tables import PoseTable
from rigs.arms import load_arm
from rigs.effects import Backlash, Compliance, Effect, JointOffset, LinkBending, TransmissionError
from rigs.load import parse
from rigs.rig import Rig
from tests.worlds import linkage as world

TOOL_MM = np.array([50.0, 20.0, 100.0])
FAULTS: dict[str, tuple[float, Effect]] = {
    "zero": (0.1, JointOffset(axis=1, offset_deg=0.1)),
    "play": (0.1, Backlash(axis=1, width_deg=0.1)),
    "wave": (0.1, TransmissionError(axis=1, order=8, amplitude_deg=0.1, phase_deg=0)),
    "soft": (1e-3, Compliance(axis=1, deg_per_Nm=1e-3)),
}


def rig_for(name: str) -> Rig:
    """An arm of the library, with masses, or with the linkage of a palletiser."""
    shape = world.SHAPES[name]
    robot = load_arm("fanuc-m-10ia" if shape.drive == "crank" else name).robot
    upper = {"mass_kg": 12.0, "centre_mm": (shape.upper / 2, 0.0, 0.0)}
    forearm = {"mass_kg": 8.0, "centre_mm": (shape.elbow, shape.forearm / 2, 0.0)}
    axes = tuple(
        axis.model_copy(update={1: upper, 2: forearm}.get(k, {})) for k, axis in enumerate(robot.axes)
    )  # fmt: skip
    update = {"axes": axes, "payload_kg": 5.0} | ({"drives": robot.coupling} if shape.drive == "crank" else {})
    rig = parse("name: linkage\n" + load_arm("ur5e").text, "linkage.yaml")
    return rig.model_copy(update={"robot": robot.model_copy(update=update)})


@pytest.mark.parametrize("name", world.SHAPES)
@pytest.mark.parametrize("kind", FAULTS)
@pytest.mark.parametrize("axis", [2, 3])
def test_motor_error_moves_the_tool_as_mechanics_predict(name, kind, axis):
    rng, shape = np.random.default_rng([4, axis]), world.SHAPES[name]
    sound = world.LinkedArm(shape, world.NO_ERRORS, TOOL_MM)
    size, effect = FAULTS[kind]
    motors = world.postures(shape, 20, rng)
    came_from = motors + rng.uniform(0.1, 0.3, motors.shape) * rng.choice([-1, 1], motors.shape)
    really = world.with_fault(sound, kind, axis, size).tips(motors, came_from)
    table = PoseTable(sound.displayed(motors), really, None, came_from=sound.displayed(came_from))
    model = model_of(rig_for(name), [effect.model_copy(update={"axis": axis})])
    T = moved(model, path_of(model, table)).T
    off_mm = np.linalg.norm(really - sound.tips(motors, came_from), axis=1).max()
    assert off_mm > 0.1
    assert np.abs(T[:, :3, 3] + T[:, :3, :3] @ TOOL_MM - really).max() < 0.005 * off_mm


def test_linkage_relieves_the_upper_arm_of_the_forearm_moment():
    bends = LinkBending(axis=2, mm_per_Nm=1e-3)
    q = np.zeros((1, 6))
    places = {}
    for name in ("fanuc-m-10ia", "palletiser"):
        model = model_of(rig_for(name), [bends])
        table = PoseTable(q, q[:, :3], None)
        plain = moved(replace(model, effects=()), path_of(model, table)).T
        places[name] = float(np.linalg.norm((moved(model, path_of(model, table)).T - plain)[0, :3, 3]))
    # The upper arm is upright: only the forearm, which the rod carries, has a moment about axis 2.
    assert places["palletiser"] < 1e-9
    assert places["fanuc-m-10ia"] > 0.05


def test_zeros_of_drives_become_zeros_of_the_axes_that_they_turn():
    rng = np.random.default_rng(5)
    for name in ("fanuc-m-10ia", "palletiser"):
        model = model_of(rig_for(name), [JointOffset(axis=2, offset_deg=0.3), JointOffset(axis=3, offset_deg=-0.2)])
        q = rng.uniform(-1, 1, (4, 6))
        T = moved(model, path_of(model, PoseTable(q, q[:, :3], None))).T
        bare = replace(model, arm=geometric_arm(model), effects=())
        np.testing.assert_allclose(moved(bare, path_of(bare, PoseTable(q, q[:, :3], None))).T, T, atol=1e-9)


def test_angles_of_drives_and_reported_angles_convert_into_each_other():
    arm, q = arm_of(load_arm("fanuc-m-10ia").robot), np.random.default_rng(6).uniform(-1, 1, (5, 6))
    drives = drive_angles(arm, q)
    np.testing.assert_allclose(drives[:, 2], q[:, 1] + q[:, 2], atol=1e-15)
    np.testing.assert_allclose(reported_angles(arm, drives), q, atol=1e-15)
