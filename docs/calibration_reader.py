"""Compute poses of a calibrated arm from its rig file and calibration file, without rig.

It needs numpy and PyYAML. docs/calibration.md describes the files. The arm is in modified Denavit-Hartenberg form. Link
constants among the effects change the arm; effects of joints are computed from the angles m of the drives and added to
them; bending moves the tool; a compliant base rotates and moves the arm.

    arm, effects, model = read("better.yaml")
    tool(arm, effects, q)  # the frame of the tool at reported joint angles q (6,) rad
    u_of_place(arm, effects, model, q)  # ten seconds per posture for 1500 terms
"""

import base64
import copy
import json
import pathlib

import numpy as np
import yaml


def turn(axis, angle):
    T, j, k = np.eye(4), (axis + 1) % 3, (axis + 2) % 3
    T[[j, k], [j, k]], T[k, j], T[j, k] = np.cos(angle), np.sin(angle), -np.sin(angle)
    return T


def move(x, y, z):
    return np.block([[np.eye(3), np.array([[x], [y], [z]])], [np.zeros(3), 1]])


def frame(pose):
    roll, pitch, yaw = np.radians(pose.get("rpy_deg", (0, 0, 0)))
    return move(*pose.get("xyz_mm", (0, 0, 0))) @ turn(2, yaw) @ turn(1, pitch) @ turn(0, roll)


def frames(arm, m):
    """The frames of the six joints and of the tool in the world (7, 4, 4), mm, at angles m (6,) rad of the drives."""
    T, found = frame(arm.get("base", {})), []
    for axis, angle in zip(arm["axes"], drives_of(arm) @ m, strict=False):
        alpha, beta, offset = (np.radians(axis.get(key, 0)) for key in ("alpha_deg", "beta_deg", "offset_deg"))
        T = T @ turn(0, alpha) @ move(axis.get("a_mm", 0), 0, 0) @ turn(1, beta)
        T = T @ turn(2, angle + offset) @ move(0, 0, axis.get("d_mm", 0))
        found.append(T)
    return np.array([*found, T @ frame(arm.get("tool", {}))])


def coupling_of(arm):
    return np.array(arm.get("coupling", np.eye(6)))


def drives_of(arm):
    return np.array(arm.get("drives", np.diag(np.diag(coupling_of(arm)))))


def weights(arm, T, more_kg=0.0):
    """Masses (7,) kg of links and payload, increased by more_kg, and their positions (7, 3) mm."""
    hangs = max(arm.get("payload_kg", 0) + more_kg, 0)
    mass = np.array([axis.get("mass_kg", 0) for axis in arm["axes"]] + [hangs])
    centre = [T[i] @ [*axis.get("centre_mm", (0, 0, 0)), 1] for i, axis in enumerate(arm["axes"])] + [T[5, :, 3]]
    return mass, np.array(centre)[:, :3]


def torques(arm, m, more_kg=0.0):
    """The torque of gravity on each drive (6,) Nm."""
    T = frames(arm, m)
    mass, centre = weights(arm, T, more_kg)
    pull = [mass[i:] @ (centre[i:] - T[i, :3, 3]) for i in range(6)]  # first moment beyond each joint, kg mm
    return drives_of(arm).T @ [9.80665e-3 * (T[i, 1, 2] * pull[i][0] - T[i, 0, 2] * pull[i][1]) for i in range(6)]


def moment(arm, m):
    """The moment of gravity (3,) Nm about the origin of the base, in its axes."""
    base = frame(arm.get("base", {}))
    mass, centre = weights(arm, frames(arm, m))
    x, y, _ = 9.80665e-3 * mass @ (centre - base[:3, 3])
    return base[:3, :3].T @ [-y, x, 0.0]


def turned(effect, arm, m):
    """The joint (from 1) that an effect turns, and the angle in rad."""
    axis, angle = effect.get("axis", effect.get("to_axis", 1)), 0.0
    match effect["effect"]:
        case "joint_offset":
            angle = np.radians(effect["offset_deg"])
        case "wrist_coupling":
            angle = effect["ratio"] * m[effect["from_axis"] - 1]
        case "transmission_error":
            phase = effect["order"] * m[axis - 1] + np.radians(effect.get("phase_deg", 0))
            angle = np.radians(effect["amplitude_deg"]) * (np.sin(phase) + effect.get("third", 0) * np.sin(3 * phase))
        case "joint_scale":
            angle = effect["relative"] * m[axis - 1]
        case "strain_wave":  # static; the hysteresis loss depends on the path
            torque, knee = torques(arm, m)[axis - 1], effect.get("knee_Nm", 40)
            parts = np.clip(abs(torque) - knee * np.array([0, 1, 3.5]), 0, knee * np.array([1, 2.5, np.inf]))
            angle = np.radians(effect["deg_per_Nm"]) * np.sign(torque) * (parts @ [1, 1 / 1.55, 1 / 1.75])
        case "compliance":
            angle = np.radians(effect["deg_per_Nm"]) * torques(arm, m, effect.get("payload_kg", 0))[axis - 1]
    return axis, angle


ABOUT_DEG = {"x": 0, "xy": 45, "y": 90, "yx": 135}


def carried(effect, times, arm, m, T):
    """The frame T (4, 4) of the tool, mm, on a compliant base."""
    base, load = frame(arm.get("base", {})), moment(arm, m)
    if effect["effect"] == "base_sags":
        up = times * effect["mm_per_Nm"] * load["xy".index(effect["way"])]
        return move(*up * base[:3, 2]) @ T
    load[2] = 0
    if effect["way"] != "evenly":
        line = turn(2, np.radians(ABOUT_DEG[effect["way"]]))[:3, 0]
        load = line * (line @ load)
    v = times * np.radians(effect["deg_per_Nm"]) * load
    angle = np.linalg.norm(v)
    x, y, z = v / max(angle, 1e-300)
    K = np.array([[0, -z, y, 0], [z, 0, -x, 0], [-y, x, 0, 0], [0, 0, 0, 0]])
    pivot = base @ move(0, 0, -effect.get("below_mm", 0))
    return pivot @ (np.eye(4) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K) @ np.linalg.inv(pivot) @ T


def tool(arm, effects, q):
    """The frame of the tool (4, 4) in the world, mm, at reported angles q (6,) rad; effects: pairs (effect, times)."""
    arm, m = copy.deepcopy(arm), np.linalg.solve(drives_of(arm), coupling_of(arm) @ q)
    link_m = m.copy()
    for effect, times in effects:
        if effect["effect"] == "link_geometry":
            axis, key = (
                arm["axes"][effect["axis"] - 1],
                effect["field"] + ("_mm" if effect["field"] in "ad" else "_deg"),
            )
            axis[key] = axis.get(key, 0) + times * effect["delta"]
    for effect, times in effects:
        axis, angle = turned(effect, arm, m)
        link_m[axis - 1] += times * angle
    T = frames(arm, link_m)
    for effect, times in effects:
        if effect["effect"] == "link_bending":
            i = effect["axis"] - 1
            across = np.cross(T[i, :3, 2], T[i + 1, :3, 3] - T[i, :3, 3])
            if np.linalg.norm(across) > 1e-6:  # a link of zero length across the axis does not bend
                T[6, :3, 3] += times * effect["mm_per_Nm"] * torques(arm, m)[i] * across / np.linalg.norm(across)
        elif effect["effect"] in ("base_yields", "base_sags"):
            T[6] = carried(effect, times, arm, m, T[6])
    return T[6]


def read(path):
    """The arm, the effects with multipliers, and the calibration of a rig file."""
    rig = yaml.safe_load(pathlib.Path(path).read_text())
    model = json.loads((pathlib.Path(path).parent / rig["calibration"]["file"]).read_text())
    effects = [(effect, 1.0) for effect in rig.get("effects") or []]
    return rig["robot"], effects + [(t["effect"], t["times"]) for t in model["terms"] if not t["named"]], model


def u_of_place(arm, effects, model, q):
    """The standard uncertainty in mm of the tool position, all three coordinates together."""
    here, count, J = tool(arm, effects, q), len(model["parameters"]), []
    for one in model["parameters"]:
        effect, field, step = model["terms"][one["term"]]["effect"], one["field"], 1.0
        more = [(effect, 1.0)]
        if field != "times":
            step = 1e-3 * (abs(effect[field]) or 1.0)
            more = [(effect | {field: effect[field] + step}, 1.0), (effect, -1.0)]
        J.append((tool(arm, effects + more, q) - here)[:3, 3] / step)
    L = np.zeros((count, count))
    L[np.tril_indices(count)] = np.frombuffer(base64.b64decode(model["factor"]), dtype="<f4")
    return np.linalg.norm(L.T @ np.array(J))
