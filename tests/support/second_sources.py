"""Independent published data of the library arms, evaluated in their own notation.

Only `differences` uses the library:

- `Chain`: joints of a URDF with the numbers of the file (metres, radians).
- `catalogue`: modified Denavit-Hartenberg rows, senses and coupled joints of robotkinematicscatalogue 1.1.2.
- `classic`: classic Denavit-Hartenberg rows: the notation of Universal Robots, and of FANUC with the lengths listed in
underautomation/Fanuc.NET.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import pi

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from analysis.robot.kinematics.arm import arm_of, forward
from rigs.schema.robot import Robot

Array = NDArray[np.float64]
Numbers = tuple[float, ...]
Source = Callable[[Array], Array]
"""Function from joint angles (n, axes) rad of the controller to poses (n, 4, 4) of the flange in the base frame, in
mm.
"""

O = (0.0, 0.0, 0.0)  # noqa: E741 - origin
X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


def _minus(axis: Numbers) -> Numbers:
    return tuple(-one for one in axis)


def _frame(xyz: Sequence[float], rpy: Sequence[float]) -> Array:
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler("xyz", rpy).as_matrix()
    T[:3, 3] = np.multiply(1000.0, xyz)
    return T


@dataclass(frozen=True)
class Chain:
    """Joints of a URDF: xyz (m), rpy (rad) and axis of each. tool: xyz and rpy. base_m: height of the library's base
    above the first link. j3_counts_j2: the third joint of the URDF is J2 + J3 of the controller.
    """

    joints: tuple[tuple[Numbers, Numbers, Numbers], ...]
    tool: tuple[Numbers, Numbers] = (O, O)
    base_m: float = 0.0
    j3_counts_j2: bool = False

    def __call__(self, q: Array) -> Array:
        turns = q.copy()
        if self.j3_counts_j2:
            turns[:, 2] += turns[:, 1]
        T = np.broadcast_to(_frame((0, 0, -self.base_m), O), (len(q), 4, 4))
        for (xyz, rpy, axis), turn in zip(self.joints, turns.T, strict=True):
            R = np.broadcast_to(np.eye(4), (len(q), 4, 4)).copy()
            R[:, :3, :3] = Rotation.from_rotvec(np.outer(turn, axis)).as_matrix()
            T = T @ _frame(xyz, rpy) @ R
        return T @ _frame(*self.tool)

    def urdf(self, limit: str = '<limit lower="-3" upper="2.5" velocity="3.5" effort="0"/>') -> str:
        """Chain as a URDF file, from the link `base_link` to `tool0`."""
        links = ["base_link", *(f"link_{one}" for one in range(1, len(self.joints) + 1)), "tool0"]
        parts = [f'<link name="{name}"/>' for name in links]
        for one, (xyz, rpy, axis) in enumerate(self.joints):
            parts.append(
                f'<joint name="joint_{one + 1}" type="revolute"><parent link="{links[one]}"/>'
                f'<child link="{links[one + 1]}"/>{_origin(xyz, rpy)}<axis xyz="{_words(axis)}"/>{limit}</joint>'
            )
        ends = f'<parent link="link_{len(self.joints)}"/><child link="tool0"/>'
        parts.append(f'<joint name="flange" type="fixed">{ends}{_origin(*self.tool)}</joint>')
        return '<?xml version="1.0"?>\n<robot name="chain">' + "\n".join(parts) + "</robot>\n"


def _words(numbers: Sequence[float]) -> str:
    return " ".join(repr(float(one)) for one in numbers)


def _origin(xyz: Sequence[float], rpy: Sequence[float]) -> str:
    return f'<origin xyz="{_words(xyz)}" rpy="{_words(rpy)}"/>'


def _upright(
    places: Sequence[Numbers],
    axes: Sequence[Numbers],
    tool: tuple[Numbers, Numbers],
    base_m: float = 0.0,
    j3_counts_j2: bool = False,
) -> Chain:
    """A chain whose frames are all parallel to the base at zero."""
    joints = tuple((xyz, O, axis) for xyz, axis in zip(places, axes, strict=True))
    return Chain(joints, tool, base_m, j3_counts_j2)


def _fanuc(j1: float, j2: float, j3: float, j4: float, j5: float, j6: float) -> Chain:
    """A chain of ros-industrial/fanuc: positions of the joints along z, x, z, z, x, x."""
    places = [(0, 0, j1), (j2, 0, 0), (0, 0, j3), (0, 0, j4), (j5, 0, 0), (j6, 0, 0)]
    axes = [Z, Y, _minus(Y), _minus(X), _minus(Y), _minus(X)]
    return _upright(places, axes, (O, (pi, -pi / 2, 0)), base_m=j1, j3_counts_j2=True)


def _yaskawa(j1: float, j2: float, j3: float, j4: tuple[float, float], tool: float) -> Chain:
    """A chain of ros-industrial/motoman: positions along z, x, z, (x, z), and the tool along x."""
    places = [(0, 0, j1), (j2, 0, 0), (0, 0, j3), (j4[0], 0, j4[1]), O, O]
    axes = [Z, Y, _minus(Y), _minus(X), _minus(Y), _minus(X)]
    return _upright(places, axes, ((tool, 0, 0), (3.1415926, -1.570796, 0)), base_m=j1)


def _abb(places: Sequence[Numbers]) -> Chain:
    return _upright(places, [Z, Y, Y, X, Y, X], (O, (0, pi / 2, 0)))


def _kuka(*places: Numbers) -> Chain:
    """A chain of ros-industrial/kuka_experimental."""
    axes = [_minus(Z), Y, Y, _minus(X), Y, _minus(X)]
    return _upright(places, axes, (O, (0, pi / 2, 0)))


def _kawasaki(j3: float, j5: float) -> Chain:
    """A chain of Kawasaki-Robotics/khi_robot."""
    turn, back = (0, -pi / 2, 0), (0, pi / 2, 0)
    down = _minus(Z)
    joints = (
        ((0, 0, 0.36), O, down),
        (O, turn, Z),
        ((j3, 0, 0), O, down),
        ((0.0925, 0, 0), back, Z),
        ((0, 0, j5), turn, down),
        ((0.078, 0, 0), back, Z),
    )
    return Chain(joints, base_m=0.36)


def _ur(d1: float, a2: float, a3: float, d4: float, d5: float, d6: float) -> Chain:
    """A chain of ros-industrial/universal_robot, default_kinematics.yaml, with right angles given to nine
    decimals.
    """
    right, slip = 1.570796327, 2.05103e-10
    joints = (
        ((0, 0, d1), O, Z),
        (O, (right, 0, 0), Z),
        ((a2, 0, 0), O, Z),
        ((a3, 0, d4), O, Z),
        ((0, -d5, -d5 * slip), (right, 0, 0), Z),
        ((0, d6, -d6 * slip), (1.570796326589793, pi, pi), Z),
    )
    return Chain(joints)


DOOSAN_ANGLE = 1.571
_KROSHU_KR6 = Chain(
    (
        ((0, 0, 0.208), (pi, 0, 0), Z),
        ((0.025, -0.0907, -0.192), (pi / 2, 0, 0), Z),
        ((0.455, 0, -0.0042), O, Z),
        ((0.196, -0.025, -0.0865), (pi / 2, 0, -pi / 2), Z),
        ((0, 0.0505, -0.224), (0, pi / 2, pi / 2), Z),
        ((0.0615, 0, -0.0505), (pi / 2, 0, -pi / 2), Z),
    ),
    tool=((0, 0, -0.0285), (pi, 0, pi)),
)
_KROSHU_KR10 = Chain(
    (
        (O, (-pi, 0, 0), Z),
        ((0.025, 0, -0.4), (pi / 2, 0, 0), Z),
        ((0.56, 0, 0), (0, 0, -pi / 2), Z),
        ((0.025, 0, 0), (pi / 2, 0, 0), Z),
        ((0, 0, -0.515), (-pi / 2, 0, 0), Z),
        (O, (pi / 2, 0, 0), Z),
    ),
    tool=((0, 0, -0.09), (0, pi, 0)),
)
_DOOSAN = Chain(
    (
        ((0, 0, 0.1525), O, Z),
        ((0, 0.0345, 0), (0, -DOOSAN_ANGLE, -DOOSAN_ANGLE), Z),
        ((0.62, 0, 0), (0, 0, DOOSAN_ANGLE), Z),
        ((0, -0.559, 0), (DOOSAN_ANGLE, 0, 0), Z),
        (O, (-DOOSAN_ANGLE, 0, 0), Z),
        ((0, -0.121, 0), (DOOSAN_ANGLE, 0, 0), Z),
    )
)


def catalogue(rows: Sequence[Numbers], senses: Numbers = (), j3_counts_j2: bool = False) -> Source:
    """Source for rows of alpha (degrees), a, d (mm), theta (degrees). A third joint relative to J2 is
    converted.
    """

    def poses(q: Array) -> Array:
        turns = q * (senses or (1,) * q.shape[1])
        if j3_counts_j2:
            turns[:, 2] -= senses[1] * q[:, 1]
        T = np.broadcast_to(np.eye(4), (len(q), 4, 4))
        for (alpha, a, d, theta), turn in zip(rows, turns.T, strict=True):
            T = T @ _turns("x", np.radians(alpha)) @ _frame((a / 1000, 0, 0), O)
            T = T @ _turns("z", turn + np.radians(theta)) @ _frame((0, 0, d / 1000), O)
        return T

    return poses


def classic(rows: Sequence[Numbers], j3_counts_j2: bool = False) -> Source:
    """Source for rows of theta (degrees), d, a (mm), alpha (degrees): RotZ TransZ TransX RotX."""

    def poses(q: Array) -> Array:
        turns = q.copy()
        if j3_counts_j2:
            turns[:, 2] += turns[:, 1]
        T = np.broadcast_to(np.eye(4), (len(q), 4, 4))
        for (theta, d, a, alpha), turn in zip(rows, turns.T, strict=True):
            T = T @ _turns("z", turn + np.radians(theta)) @ _frame((a / 1000, 0, d / 1000), O)
            T = T @ _turns("x", np.radians(alpha))
        return T

    return poses


def _turns(axis: str, angle: Array | float) -> Array:
    """Return rotations (n, 4, 4) about an axis."""
    angles = np.atleast_1d(np.asarray(angle, dtype=float))
    T = np.broadcast_to(np.eye(4), (len(angles), 4, 4)).copy()
    T[:, :3, :3] = Rotation.from_euler(axis, angles[:, None]).as_matrix()
    return T


def _rows(a: Numbers, d: Numbers, theta: Numbers) -> list[Numbers]:
    """Return catalogue rows for an arm with a spherical wrist."""
    return list(zip((0, -90, 0, -90, 90, -90), a, d, theta, strict=True))


def _catalogue_fanuc(a1: float, a2: float, a3: float, d4: float, d6: float) -> Source:
    rows = _rows((0, a1, a2, a3, 0, 0), (0, 0, 0, d4, 0, d6), (0, -90, 0, 0, 0, 0))
    return catalogue(rows, (1, 1, -1, -1, -1, -1), j3_counts_j2=True)


def _catalogue_yaskawa(a1: float, a2: float, a3: float, d4: float, d6: float) -> Source:
    rows = _rows((0, a1, a2, a3, 0, 0), (0, 0, 0, d4, 0, d6), (0, -90, 0, 0, 0, 0))
    return catalogue(rows, (1, 1, -1, -1, -1, -1))


def _catalogue_kuka(a2: float, a3: float, d4: float, d6: float) -> Source:
    rows = _rows((0, 25, a2, a3, 0, 0), (400, 0, 0, d4, 0, d6), (0, 0, -90, 0, 0, 180))
    return catalogue(rows, (-1, 1, 1, -1, 1, -1))


def _catalogue_kawasaki(a2: float, d4: float) -> Source:
    rows = _rows((0, 0, a2, 0, 0, 0), (0, 0, 0, d4, 0, 78), (90, -90, -90, 0, 0, 90))
    return catalogue(rows, (-1, 1, -1, 1, -1, 1))


def _classic_fanuc(d4: float, d5: float, d6: float, a1: float, a2: float, a3: float) -> Source:
    """A FANUC arm with lengths of underautomation/Fanuc.NET and the angles of FANUC's own classic rows."""
    rows = [(0, 0, a1, -90), (-90, 0, a2, 180), (0, 0, a3, -90), (0, d4, 0, 90), (0, d5, 0, -90), (0, d6, 0, 180)]
    return classic(rows, j3_counts_j2=True)


def _classic_ur(d1: float, a2: float, a3: float, d4: float, d5: float, d6: float) -> Source:
    rows = [(0, d1, 0, 90), (0, 0, a2, 0), (0, 0, a3, 0), (0, d4, 0, 90), (0, d5, 0, -90), (0, d6, 0, 0)]
    return classic(rows)


_RIGHT = 1.57079632679
_FRANKA = Chain(
    (
        ((0, 0, 0.333), O, Z),
        (O, (-pi / 2, 0, 0), Z),
        ((0, -0.316, 0), (pi / 2, 0, 0), Z),
        ((0.0825, 0, 0), (pi / 2, 0, 0), Z),
        ((-0.0825, 0.384, 0), (-pi / 2, 0, 0), Z),
        (O, (pi / 2, 0, 0), Z),
        ((0.088, 0, 0), (pi / 2, 0, 0), Z),
    ),
    tool=((0, 0, 0.107), O),
)
_IIWA = _upright(
    [O, (-0.00043624, 0, 0.36), O, (0.00043624, 0, 0.42), O, (0, 0, 0.4), O],
    [Z, Y, Z, _minus(Y), Z, Y, Z],
    ((0, 0, 0.126), O),
)
_IIWA_STACK = Chain(
    (
        ((0, 0, 0.1575), O, Z),
        ((0, 0, 0.2025), (_RIGHT, 0, pi), Z),
        ((0, 0.2045, 0), (_RIGHT, 0, pi), Z),
        ((0, 0, 0.2155), (_RIGHT, 0, 0), Z),
        ((0, 0.1845, 0), (-_RIGHT, pi, 0), Z),
        ((0, 0, 0.2155), (_RIGHT, 0, 0), Z),
        ((0, 0.081, 0), (-_RIGHT, pi, 0), Z),
    ),
    tool=((0, 0, 0.045), (pi, pi, pi)),
)
_WAM = [(0, 0, 0, -90), (0, 0, 0, 90), (0, 550, 45, -90), (0, 0, -45, 90), (0, 300, 0, -90), (0, 0, 0, 90)]

_SO_101 = Chain(
    (
        ((0.0388353, 0, 0.0624), (pi, 0, pi), Z),
        ((-0.0303992, -0.0182778, -0.0542), (-pi / 2, -pi / 2, 0), Z),
        ((-0.11257, -0.028, 0), (0, 0, pi / 2), Z),
        ((-0.1349, 0.0052, 0), (0, 0, -pi / 2), Z),
        ((0, -0.0611, 0.0181), (pi / 2, 0.0486795, pi), Z),
    )
)


def quaternions(bodies: Sequence[tuple[Numbers, Numbers]]) -> Source:
    """Source for MuJoCo bodies with position (m) and quaternion (w, x, y, z), whose joints turn about z."""

    def poses(q: Array) -> Array:
        T = np.broadcast_to(np.eye(4), (len(q), 4, 4))
        for (xyz, (w, *vector)), turn in zip(bodies, q.T, strict=True):
            body = _frame(xyz, O)
            body[:3, :3] = Rotation.from_quat([*vector, w]).as_matrix()
            T = T @ body @ _turns("z", turn)
        return T

    return poses


_SO_101_BODIES = [
    ((0.0388353, -8.97657e-09, 0.0624), (3.56167e-16, 1.22818e-15, -1, -4.14635e-16)),
    ((-0.0303992, -0.0182778, -0.0542), (0.5, -0.5, -0.5, -0.5)),
    ((-0.11257, -0.028, 1.73763e-16), (0.707107, -5.98613e-17, -2.58051e-17, 0.707107)),
    ((-0.1349, 0.0052, 3.62355e-17), (0.707107, 9.58722e-16, -7.51313e-16, -0.707107)),
    ((5.55112e-17, -0.0611, 0.0181), (0.0172091, -0.0172091, 0.706897, 0.706897)),
]


def screws(rows: Sequence[Numbers], home: Numbers) -> Source:
    """Source for screw axes (rotation, then moment, m) in the base and the home position (m) of the tool.

    The tool is rotated so that its z axis points along the x axis of the base (K. M. Lynch, F. C. Park, Modern
    Robotics, 2017).
    """

    def poses(q: Array) -> Array:
        T = np.broadcast_to(np.eye(4), (len(q), 4, 4))
        for (*turn, mx, my, mz), angle in zip(rows, q.T, strict=True):
            axis = np.array(turn)
            point = 1000 * np.cross(axis, (mx, my, mz))
            step = np.broadcast_to(np.eye(4), (len(q), 4, 4)).copy()
            step[:, :3, :3] = Rotation.from_rotvec(np.outer(angle, axis)).as_matrix()
            step[:, :3, 3] = point - step[:, :3, :3] @ point
            T = T @ step
        return T @ _frame(home, (0, pi / 2, 0))

    return poses


_WIDOWX = [(0, 0, 1, 0, 0, 0), (0, 1, 0, -0.11065, 0, 0), (0, 1, 0, -0.36065, 0, 0.04975)]
_WIDOWX_PITCH, _WIDOWX_ROLL = (0, 1, 0, -0.36065, 0, 0.29975), (1, 0, 0, 0, 0.36065, 0)
_WIDOWX_TOOL = ((0, 0, 0), (0, pi / 2, 0))
_WIDOWX_SHOULDER = [(0, 0, 0.072), (0, 0, 0.03865), (0.04975, 0, 0.25)]
_WIDOWX_HOME = (0.36475, 0, 0.36065)
"""The tool of that module is 93.575 mm further out, between the fingers."""
_XARM_6 = Chain(
    (
        ((0, 0, 0.267), O, Z),
        (O, (-pi / 2, 0, 0), Z),
        ((0.0535, -0.2845, 0), O, Z),
        ((0.0775, 0.3425, 0), (-pi / 2, 0, 0), Z),
        (O, (pi / 2, 0, 0), Z),
        ((0.076, 0.097, 0), (-pi / 2, 0, 0), Z),
    )
)
_XARM_7 = Chain(
    (
        ((0, 0, 0.267), O, Z),
        (O, (-pi / 2, 0, 0), Z),
        ((0, -0.293, 0), (pi / 2, 0, 0), Z),
        ((0.0525, 0, 0), (pi / 2, 0, 0), Z),
        ((0.0775, -0.3425, 0), (pi / 2, 0, 0), Z),
        (O, (pi / 2, 0, 0), Z),
        ((0.076, 0.097, 0), (-pi / 2, 0, 0), Z),
    )
)


_XARM_7_ROWS = [
    (0, 0, 267, 0), (-90, 0, 0, 0), (90, 0, 293, 0), (-90, 52.2, 0, 180), (90, -77.5, 342.5, 0), (-90, 0, 0, 0),
    (90, -76, 97, 180),
]  # fmt: skip


def _catalogue_xarm_6(a2: float, shoulder_deg: float) -> Source:
    return catalogue(
        _rows((0, 0, a2, 77.5, 0, 76), (267, 0, 0, 342.5, 0, 97), (0, -shoulder_deg, shoulder_deg, 0, 0, 0))
    )


_GEN3 = Chain(
    (
        ((0, 0, 0.15643), (pi, 0, 0), Z),
        ((0, 0.005375, -0.12838), (pi / 2, 0, 0), Z),
        ((0, -0.21038, -0.006375), (-pi / 2, 0, 0), Z),
        ((0, 0.006375, -0.21038), (pi / 2, 0, 0), Z),
        ((0, -0.20843, -0.006375), (-pi / 2, 0, 0), Z),
        ((0, 0.00017505, -0.10593), (pi / 2, 0, 0), Z),
        ((0, -0.10593, -0.00017505), (-pi / 2, 0, 0), Z),
    ),
    tool=((0, 0, -0.061525), (pi, 0, 0)),
)
_GEN3_GUIDE = [
    (0, 0, 0, 180), (0, -284.8, 0, 90), (180, -11.8, 0, 90), (180, -420.8, 0, 90), (180, -12.8, 0, 90),
    (180, -314.3, 0, 90), (180, 0, 0, 90), (180, -167.4, 0, 180),
]  # fmt: skip
"""Table of the user guide. Its first row is the base, which turns with no joint."""


def _gen3_guide(q: Array) -> Array:
    base = _turns("x", pi)
    return np.asarray(base @ classic(_GEN3_GUIDE[1:])(q))


SOURCES: dict[str, dict[str, Source]] = {
    "so-101": {"geometry": _SO_101, "second": quaternions(_SO_101_BODIES)},
    "widowx-250": {
        "geometry": _upright([*_WIDOWX_SHOULDER, (0.25, 0, 0), (0.065, 0, 0)], [Z, Y, Y, Y, X], _WIDOWX_TOOL),
        "second": screws([*_WIDOWX, _WIDOWX_PITCH, _WIDOWX_ROLL], _WIDOWX_HOME),
    },
    "widowx-250s": {
        "geometry": _upright(
            [*_WIDOWX_SHOULDER, (0.175, 0, 0), (0.075, 0, 0), (0.065, 0, 0)], [Z, Y, Y, X, Y, X], _WIDOWX_TOOL
        ),
        "second": screws([*_WIDOWX, _WIDOWX_ROLL, _WIDOWX_PITCH, _WIDOWX_ROLL], _WIDOWX_HOME),
    },
    "ufactory-xarm-6": {
        "geometry": _XARM_6,
        "second": _catalogue_xarm_6(float(np.hypot(284.5, 53.5)), float(np.degrees(np.arctan(284.5 / 53.5)))),
        "third": _catalogue_xarm_6(289.489, 79.35),
    },
    "ufactory-xarm-7": {
        "geometry": _XARM_7,
        "second": catalogue(
            _XARM_7_ROWS,
            (1, 1, 1, -1, 1, 1, 1),
        ),
    },
    "kinova-gen3-7": {"geometry": _GEN3, "second": _gen3_guide},
    "barrett-wam-7": {"geometry": classic([*_WAM, (0, 60, 0, 0)]), "second": classic([*_WAM, (0, 60.9, 0, 0)])},
    "franka-fr3": {
        "geometry": catalogue(
            list(
                zip(
                    (0, -90, 90, 90, -90, 90, 90),
                    (0, 0, 0, 82.5, -82.5, 0, 88),
                    (333, 0, 316, 0, 384, 0, 107),
                    (0,) * 7,
                    strict=True,
                )
            )
        ),
        "second": _FRANKA,
    },
    "kuka-lbr-iiwa-14": {"geometry": _IIWA_STACK, "second": _IIWA},
    "ur3": {
        "geometry": _classic_ur(151.9, -243.65, -213.25, 112.35, 85.35, 81.9),
        "second": _ur(0.1519, -0.24365, -0.21325, 0.11235, 0.08535, 0.0819),
    },
    "ur5": {
        "geometry": _classic_ur(89.159, -425, -392.25, 109.15, 94.65, 82.3),
        "second": _ur(0.089159, -0.425, -0.39225, 0.10915, 0.09465, 0.0823),
    },
    "ur10": {
        "geometry": _classic_ur(127.3, -612, -572.3, 163.941, 115.7, 92.2),
        "second": _ur(0.1273, -0.612, -0.5723, 0.163941, 0.1157, 0.0922),
    },
    "abb-irb-120": {
        "geometry": _abb([O, (0, 0, 0.29), (0, 0, 0.27), (0, 0, 0.07), (0.302, 0, 0), (0.072, 0, 0)]),
        "second": catalogue(_rows((0, 0, 270, 70, 0, 0), (290, 0, 0, 302, 0, 72), (0, -90, 0, 0, 0, 180))),
    },
    "abb-irb-1600": {
        "geometry": _abb([O, (0.15, 0, 0.4865), (0, 0, 0.7), (0.3, 0, 0), (0.3, 0, 0), (0.065, 0, 0)]),
        "second": catalogue(_rows((0, 150, 700, 0, 0, 0), (486.5, 0, 0, 600, 0, 65), (0, -90, 0, 0, 0, 180))),
    },
    "doosan-m1013": {
        "geometry": _DOOSAN,
        "second": catalogue(
            _rows((0, 0, 620, 0, 0, 0), (152.5, -34.506, 0, 559, 0, 121), (180, -90, -90, 0, 0, 0)),
            (1, -1, -1, 1, -1, 1),
        ),
    },
    "fanuc-lr-mate-200id": {
        "geometry": _fanuc(0.330, 0.050, 0.330, 0.035, 0.335, 0.080),
        "second": _catalogue_fanuc(50, 330, 35, 335, 80),
        "third": _classic_fanuc(-335, 0, -80, 50, 330, 35),
    },
    "fanuc-m-10ia": {
        "geometry": _fanuc(0.450, 0.150, 0.600, 0.200, 0.640, 0.100),
        "second": _catalogue_fanuc(150, 600, 200, 640, 100),
        "third": _classic_fanuc(-640, 0, -100, 150, 600, 200),
    },
    "fanuc-m-20ia": {
        "geometry": _fanuc(0.525, 0.150, 0.790, 0.250, 0.835, 0.100),
        "second": _catalogue_fanuc(150, 790, 250, 835, 100),
        "third": _classic_fanuc(-835, 0, -100, 150, 790, 250),
    },
    "kawasaki-rs007l": {"geometry": _kawasaki(0.455, 0.3825), "second": _catalogue_kawasaki(455, 475)},
    "kawasaki-rs007n": {"geometry": _kawasaki(0.355, 0.2825), "second": _catalogue_kawasaki(355, 375)},
    "kuka-kr-10-r1100-2": {
        "geometry": _kuka((0, 0, 0.4), (0.025, 0, 0), (0.56, 0, 0), (0.515, 0, 0.025), O, (0.09, 0, 0)),
        "second": _KROSHU_KR10,
        "third": _catalogue_kuka(560, 25, 515, 90),
    },
    "kuka-kr-10-r1100-sixx": {
        "geometry": _kuka((0, 0, 0.4), (0.025, 0, 0), (0.56, 0, 0), (0, 0, 0.035), (0.515, 0, 0), (0.08, 0, 0)),
        "second": _catalogue_kuka(560, 35, 515, 80),
    },
    "kuka-kr-6-r900-2": {
        "geometry": _kuka((0, 0, 0.4), (0.025, 0, 0), (0.455, 0, 0), (0, 0, 0.025), (0.42, 0, 0), (0.09, 0, 0)),
        "second": _KROSHU_KR6,
        "third": _catalogue_kuka(455, 25, 420, 90),
    },
    "kuka-kr-6-r900-sixx": {
        "geometry": _kuka((0, 0, 0.4), (0.025, 0, 0), (0.455, 0, 0), (0, 0, 0.035), (0.42, 0, 0), (0.08, 0, 0)),
        "second": _catalogue_kuka(455, 35, 420, 80),
    },
    "staubli-tx2-60": {
        "geometry": _upright(
            [(0, 0, 0.375), O, (0, 0.02, 0.29), O, (0, 0, 0.31), (0, 0, 0.07)],
            [Z, Y, Y, Z, Y, Z],
            (O, O),
            base_m=0.375,
        ),
        "second": catalogue(_rows((0, 0, 290, 0, 0, 0), (0, 20, 0, 310, 0, 70), (0, -90, -90, 0, 0, 180))),
    },
    "ur10e": {
        "geometry": _classic_ur(180.7, -612.7, -571.55, 174.15, 119.85, 116.55),
        "second": _classic_ur(180.70, -612.70, -571.55, 174.15, 119.85, 116.55),
    },
    "ur16e": {
        "geometry": _classic_ur(180.7, -478.4, -360, 174.15, 119.85, 116.55),
        "second": _ur(0.1807, -0.4784, -0.36, 0.17415, 0.11985, 0.11655),
        "third": _classic_ur(180.70, -478.40, -360, 174.15, 119.85, 116.55),
    },
    "ur3e": {
        "geometry": _classic_ur(151.85, -243.55, -213.2, 131.05, 85.35, 92.1),
        "second": _ur(0.15185, -0.24355, -0.2132, 0.13105, 0.08535, 0.0921),
        "third": _classic_ur(151.85, -243.55, -213.20, 131.05, 85.35, 92.10),
    },
    "ur5e": {
        "geometry": _classic_ur(162.5, -425, -392.2, 133.3, 99.7, 99.6),
        "second": _ur(0.1625, -0.425, -0.3922, 0.1333, 0.0997, 0.0996),
    },
    "yaskawa-gp12": {
        "geometry": _yaskawa(0.45, 0.155, 0.614, (0.64, 0.2), 0.1),
        "second": _catalogue_yaskawa(155, 614, 200, 640, 100),
    },
    "yaskawa-gp7": {
        "geometry": _yaskawa(0.33, 0.04, 0.445, (0.44, 0.04), 0.08),
        "second": _catalogue_yaskawa(40, 445, 40, 440, 80),
    },
}
"""Second sources of the constants of each arm: by arm, then by the kind of numbers, as in the key `sources` of an
arm.
"""


def differences(robot: Robot, source: Source, number: int) -> tuple[float, float]:
    """Largest flange differences between a robot and a source, in mm and rad, on random postures within
    the limits.
    """
    low, high = np.radians([axis.limits_deg for axis in robot.axes]).T
    q = np.random.default_rng(16).uniform(low, high, (number, len(low)))
    ours, theirs = forward(arm_of(robot), q), source(q)
    turned = Rotation.from_matrix(ours[:, :3, :3].transpose(0, 2, 1) @ theirs[:, :3, :3]).magnitude()
    return float(np.linalg.norm((ours - theirs)[:, :3, 3], axis=1).max()), float(turned.max())
