"""Export of an arm as a MuJoCo model (MJCF), with measured backlash, friction and compliance per joint.

Backlash and compliance are additional hinges on the axis of a joint, free to turn by half the backlash or with a
spring, so the main hinge has the angle reported by the controller. Source: XML reference of MuJoCo.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from analysis.apps.interchange.urdf_text import (
    RAIL_JOINT,
    add_remarks,
    joint_origins,
    joint_senses,
    numbers_text,
    rail_way,
    require_names,
    xml_text,
)
from analysis.robot.kinematics.arm import RAIL_MM, Arm, Array
from rigs.schema.robot import Robot

_DENSITY = 2700.0
"""Density of aluminium in kg/m³. Moments of inertia are unknown, and written as those of a ball of equal mass."""
_LEAST_KG = 1e-3
"""Mass of a body if the rig file contains none, because MuJoCo does not simulate massless bodies. Chosen: a gram."""
_ARMATURE = 1e-3
"""Armature in kg m² of the additional hinges of an axis, whose motion would otherwise be undetermined. Chosen: much
less than that of a rotor with a gear, which is some tenths (MuJoCo Menagerie, universal_robots_ur10e: 0.1).
"""
_HEAD = (
    "Lengths are in metres and angles in radians. The hinge with a joint's name turns by the angle that the controller "
    "reports. Moments of inertia are unknown: each link is a ball of aluminium of its mass."
)


@dataclass(frozen=True)
class JointTraits:
    """Measured joint properties by axis, from 1."""

    play_deg: Mapping[int, float] = field(default_factory=dict)
    """Full backlash."""
    compliance_deg_per_nm: Mapping[int, float] = field(default_factory=dict)
    friction_nm: Mapping[int, float] = field(default_factory=dict)


def mjcf_text(robot: Robot, arm: Arm, traits: JointTraits, where: str, remarks: Sequence[str] = ()) -> str:
    """Write an arm as MJCF, with names, limits and masses of a robot; the site `tool` is its tool.

    Raises FileError if axes are coupled or a name is invalid.
    """
    senses = joint_senses(arm, where, "MJCF")
    require_names(robot, where)
    root = ElementTree.Element("mujoco", model=robot.name)
    add_remarks(root, (_HEAD, *remarks))
    ElementTree.SubElement(root, "compiler", angle="radian")
    body = _body(ElementTree.SubElement(root, "worldbody"), "base_link", arm.T_world_base)
    if robot.rail:
        limits_m = numbers_text([end / RAIL_MM for end in robot.rail.limits_mm])
        slide = {"name": RAIL_JOINT, "type": "slide", "axis": numbers_text(rail_way(arm)), "limited": "true"}
        ElementTree.SubElement(body, "joint", slide | {"range": limits_m})
        _inertia(body, _LEAST_KG)
    for number, (axis, sense, T) in enumerate(zip(robot.axes, senses, joint_origins(arm), strict=True), start=1):
        body = _body(body, f"link_{number}", T)
        payload_kg = robot.payload_kg if number == len(robot.axes) else 0.0
        kg = max(axis.mass_kg + payload_kg, _LEAST_KG)
        _inertia(body, kg, np.array(axis.centre_mm) / 1000.0 * axis.mass_kg / kg)
        # main hinge of the joint, and hinges of measured backlash and compliance
        friction = {"frictionloss": repr(float(nm))} if (nm := traits.friction_nm.get(number)) else {}
        limits = numbers_text([float(np.radians(limit)) for limit in axis.limits_deg])
        hinges = {axis.name: {"limited": "true", "range": limits} | friction}
        if width_deg := traits.play_deg.get(number):
            half = float(np.radians(width_deg)) / 2.0
            hinges[f"{axis.name}_play"] = {"limited": "true", "range": numbers_text([-half, half])}
        if soft := traits.compliance_deg_per_nm.get(number):
            hinges[f"{axis.name}_compliance"] = {"limited": "false", "stiffness": repr(1.0 / float(np.radians(soft)))}
        along = {"type": "hinge", "axis": f"0 0 {sense}", "armature": repr(_ARMATURE)}
        for name, keys in hinges.items():
            ElementTree.SubElement(body, "joint", {"name": name} | along | keys)
    ElementTree.SubElement(body, "site", {"name": "tool"} | _place(arm.T_flange_tool))
    return xml_text(root)


def _body(parent: ElementTree.Element, name: str, T: Array) -> ElementTree.Element:
    return ElementTree.SubElement(parent, "body", {"name": name} | _place(T))


def _place(T: Array) -> dict[str, str]:
    """Position in m and quaternion, scalar first, of a frame (4, 4) mm."""
    quaternion = Rotation.from_matrix(T[:3, :3]).as_quat(scalar_first=True)
    return {"pos": numbers_text(T[:3, 3] / 1000.0), "quat": numbers_text(quaternion)}


def _inertia(body: ElementTree.Element, kg: float, centre_m: Array | Sequence[float] = (0.0, 0.0, 0.0)) -> None:
    radius_m = (3.0 * kg / (4.0 * np.pi * _DENSITY)) ** (1.0 / 3.0)
    moment = repr(float(0.4 * kg * radius_m**2))
    ElementTree.SubElement(
        body, "inertial", pos=numbers_text(centre_m), mass=repr(float(kg)), diaginertia=" ".join([moment] * 3)
    )
