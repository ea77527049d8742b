import numpy as np
import pytest

from analysis.diagnosis.diagnose import diagnose
from analysis.procedures.simulate import simulate
from analysis.robot.kinematics.arm import arm_of, forward_and_jacobian
from analysis.runs.tables import TouchTable
from rigs.arms import load_arm
from rigs.effects import JointOffset
from rigs.load import parse
from rigs.schema.effect import name_of
from tests.worlds.arms.seven_axes import run_of

TOUCH = "tests: {touch: {sockets: [A, B], touches: 40, seat: tip}}"
RIG = parse(f"name: cell\n{load_arm('ur10e').text}  tool: {{xyz_mm: [0, 0, 90]}}\n{TOUCH}\n", "cell.yaml")


@pytest.mark.cpu_limit(300)
def test_the_zero_is_named_and_not_the_scatter_of_the_tip():
    table = simulate(RIG, "touch", None, None, [JointOffset(axis=3, offset_deg=0.3)])
    _, J = forward_and_jacobian(arm_of(RIG.robot), table.q)
    missed_mm = np.random.default_rng(8).normal(0, 0.045, (len(table.q), 3))
    q = table.q + np.einsum("nij,nj->ni", np.linalg.pinv(J[:, :3]), missed_mm)
    found = diagnose(RIG, [run_of(RIG, TouchTable(table.socket, q))], [], [], lambda _: None)
    assert found.residual.unrepeated_um is None
    assert [name_of(one.effect) for one in found.standing] == ["joint_offset 3"]
