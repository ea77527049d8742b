import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from daq.protocol.poses import columns_of, flange_pose, quaternion_of, tool_fields, turn_by

RNG = np.random.default_rng(11)
VECTORS = [*RNG.normal(0, 1.5, (20, 3)), np.zeros(3), np.array([np.pi, 0, 0]), np.array([0, 1e-12, 0])]


@pytest.mark.parametrize("vector", VECTORS)
def test_rotations_are_those_of_scipy(vector):
    expected = Rotation.from_rotvec(vector)
    x, y, z, w = expected.as_quat()
    w_of, *xyz_of = turn_by(vector.tolist())
    np.testing.assert_allclose(Rotation.from_quat([*xyz_of, w_of]).as_matrix(), expected.as_matrix(), atol=1e-12)
    rpy_deg = columns_of((2 * w, 2 * x, 2 * y, 2 * z), (1, 2, 3))[3:]
    turned = Rotation.from_euler("xyz", rpy_deg, degrees=True)
    np.testing.assert_allclose(turned.as_matrix(), expected.as_matrix(), atol=1e-9)
    again = Rotation.from_quat(np.roll(quaternion_of(rpy_deg), -1))
    np.testing.assert_allclose(again.as_matrix(), expected.as_matrix(), atol=1e-9)


@pytest.mark.parametrize("vector", VECTORS)
def test_flange_is_the_tool_without_its_offset(vector):
    offset = [0.01, -0.02, 0.15, 0.2, 0.3, -1.0]
    flange = columns_of(turn_by(vector.tolist()), (400.0, -200.0, 333.0))
    tool, sent = tool_fields(flange, offset)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.from_rotvec(vector).as_matrix(), [0.4, -0.2, 0.333]
    T_flange_tool = np.eye(4)
    T_flange_tool[:3, :3], T_flange_tool[:3, 3] = Rotation.from_rotvec(offset[3:]).as_matrix(), offset[:3]
    expected = T @ T_flange_tool
    np.testing.assert_allclose(tool[:3], expected[:3, 3], atol=1e-12)
    np.testing.assert_allclose(Rotation.from_rotvec(tool[3:]).as_matrix(), expected[:3, :3], atol=1e-9)
    back = flange_pose(tool, sent)
    np.testing.assert_allclose(back[:3], flange[:3], atol=1e-9)
    turned = Rotation.from_euler("xyz", back[3:], degrees=True)
    np.testing.assert_allclose(turned.as_matrix(), T[:3, :3], atol=1e-9)
