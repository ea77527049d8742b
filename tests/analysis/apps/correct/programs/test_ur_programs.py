"""Scripts of Universal Robots: calls, starts, arcs, and points that reach a move through a routine or an expression."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from analysis.apps.correct import program_report
from analysis.apps.correct.corrected_program import CorrectedProgram
from analysis.apps.makers.reading import program_texts
from analysis.robot.kinematics.arm import arm_of, forward
from analysis.robot.kinematics.inverse import inverse
from tests.analysis.apps.correct.programs.cells import (
    NUMBER,
    OTHER,
    TCP,
    UR,
    UR_TOOL,
    corrected_cell,
    corrected_files,
    uncorrected,
    ur_files,
)
from tests.support.answers import words_of
from tests.support.refusals import refused
from tests.worlds.arms.faulty_arm import flange_at, frame, hidden, joints_of


def corrected_ur(directory: Path, name: str, text: str, **options: Any) -> CorrectedProgram:
    return corrected_cell("ur", directory, {f"{name}.script": text}, **options)


@pytest.mark.parametrize(
    "name",
    ["get_part", "set_down", "read_it", "is_there", "write_it", "request_it", "str_it", "pose_it", "socket_it", "pick"],
)
def test_routine_named_like_a_built_in_function_is_followed(name, tmp_path):
    """The routine turns the wrist over, so the line after it has that posture."""
    text = f"def {name}():\nmovej({{q7}})\nend\n{TCP}movej({{q0}})\n{name}()\nmovel({{p1}})\n"
    whole = corrected_ur(tmp_path, "a", text)
    assert not whole.left and len(whole.names) == 3
    jumped = corrected_ur(tmp_path, "b", f"{TCP}movej({{q7}})\nmovel({{p1}})\n")
    assert whole.files["a.script"].splitlines()[-1] == jumped.files["b.script"].splitlines()[-1]


def test_start_beyond_the_limits_is_refused(tmp_path):
    with refused("usage", "beyond the limits of the arm"):
        corrected_ur(tmp_path, "a", TCP + "movel({p1})\n", start=(7.0, 0.0, 0.0, 0.0, 0.0, 0.0))


def test_stated_start_has_the_effect_of_a_joint_move_to_it(tmp_path):
    for name, joints in (("near", 0), ("turned", 7)):
        rig, files = ur_files({f"{name}.script": TCP + f"movej({{q{joints}}})\nmovel({{p1}})\n"})
        angles = re.search(r"movej\(\[(.*)\]\)", files[f"{name}.script"])
        start = tuple(map(float, angles[1].split(",")))
        led = corrected_files(rig, tmp_path, files, start=start)
        assert led.start is None  # a joint move leads away from it
        moved = led.files[f"{name}.script"].splitlines()[-1]
        found = corrected_ur(tmp_path, "a", TCP + "movel({p1})\n", start=start)
        assert found.files["a.script"].splitlines()[-1] == moved
        assert any("--start-joints" in line for line in words_of(program_report.blocks(found)))
        stated = program_report.as_object(found)["start_joints_deg"]
        assert found.start and np.allclose(np.radians(stated), found.start)


def test_line_is_corrected_for_the_posture_in_which_the_arm_stands(tmp_path):
    """The arm with errors comes from the other posture, so it does not use the taught angles of the waypoint."""
    rig, files = ur_files({"a.script": TCP + "W_p={p1}\nW_q={q1}\nmovej({q7})\nmovel(W_p)\n"})
    (start,) = re.findall(r"movej\(\[(.*)\]\)", files["a.script"])
    wanted = flange_at(rig, np.radians(UR[1])) @ UR_TOOL
    near = np.array([float(one) for one in start.split(",")])
    arm = arm_of(rig.robot)
    solutions = inverse(arm, forward(arm, np.radians(UR[1])[None]))
    others = solutions.q[0][solutions.found[0]]
    stands = others[np.abs(np.sin((others - near) / 2)).sum(axis=1).argmin()]
    assert np.abs(stands - np.radians(UR[1])).max() > 1.0  # another posture
    found = corrected_files(rig, tmp_path, files)
    off_mm = []
    for text in (files["a.script"], found.files["a.script"].decode()):
        values = _numbers(text.split("\n")[1].removeprefix("W_p="))
        told = frame(1e3 * np.array(values[:3]), Rotation.from_rotvec(values[3:])) @ np.linalg.inv(UR_TOOL)
        real = flange_at(rig, joints_of(rig, told, stands), hidden()) @ UR_TOOL
        off_mm.append(float(np.linalg.norm(real[:3, 3] - wanted[:3, 3])))
    assert off_mm[0] > 0.1 and off_mm[1] < 1e-3


HANDED = {
    "a line": ("def go(p):\nmovel(p)\nend\n", "go({p1})\ngo({p2})\n", "movel({p1})\nmovel({p2})\n"),
    "an own movel": ("def movel(p):\nmovep(p)\nend\n", "movel({p1})\n", "movep({p1})\n"),
    "joint angles": ("def go(q):\nmovej(q, a=1)\nend\n", "go({q1})\nmovel({p2})\n", "movej({q1}, a=1)\nmovel({p2})\n"),
    "a variable": ("def go(v, p):\nmovel(p, v=v)\nend\n", "a = {p1}\ngo(0.2, a)\n", "a = {p1}\nmovel(a)\n"),
    "a named argument": ("def go(v, p):\nmovel(p, v=v)\nend\n", "go(p={p1}, v=1)\n", "movel({p1}, v=1)\n"),
    "an arc": ("def go(p, r):\nmovec(p, r)\nend\n", "go({p1}, {p2})\n", "movec({p1}, {p2})\n"),
    "handed on": (
        "def one(p):\nmovel(p)\nend\ndef go(p):\nsleep(1)\none(p)\nend\n", "go({p1})\ngo({p2})\n",
        "movel({p1})\nmovel({p2})\n",
    ),
    "another tool there": (
        "def go(p):\n" + OTHER + "movel(p)\n" + TCP + "end\n", "go({p1})\nmovel({p2})\n",
        OTHER + "movel({p1})\n" + TCP + "movel({p2})\n",
    ),
    "the posture there": (
        "def go(p):\nmovej({q7})\nmovel(p)\nend\n", "go({p1})\n", "movej({q7})\nmovel({p1})\n",
    ),
    "a routine inside": (
        "def all():\ndef go(p):\nmovel(p)\nend\ngo({p1})\nend\n", "all()\n", "movel({p1})\n",
    ),
}  # fmt: skip


def _poses(text: bytes, routines: int) -> list[bytes]:
    return [pose for line in text.splitlines()[routines:] for pose in re.findall(rb"p?\[[^\]]*\]", line)]


@pytest.mark.parametrize("row", HANDED)
def test_point_handed_to_a_routine_is_corrected_as_if_written_there(row, tmp_path):
    routine, calls, written = HANDED[row]
    found = corrected_ur(tmp_path, "a", routine + TCP + "movej({q0})\n" + calls)
    told = corrected_ur(tmp_path, "b", TCP + "movej({q0})\n" + written)
    assert not uncorrected(found) and not uncorrected(told)
    assert sorted(set(_poses(found.files["a.script"], 0))) == sorted(set(_poses(told.files["b.script"], 0)))


ABOVE = {
    "in the tool": ("", "pose_trans(a, p[0, 0, -0.02, 0, 0, 0])"),
    "in the tool by a constant": ("h = 0.02\n", "pose_trans(a, p[0, 0, -h, 0, 0, 0])"),
    "in the tool by a variable": ("o = p[0, 0, -0.02, 0, 0, 0]\n", "pose_trans(a, o)"),
    "in the tool by an expression": ("h = 0.01\n", "pose_trans(a, p[0, 0, -2 * h, 0, 0, 0])"),
    "in the tool with named arguments": ("", "pose_trans(p_from=a, p_from_to=p[0, 0, -0.02, 0, 0, 0])"),
    "in the base": ("", "pose_add(a, p[0, 0, 0.02, 0, 0, 0])"),
    "in the base by coordinates": ("", "p[a[0], a[1], a[2] + 0.02, a[3], a[4], a[5]]"),
    "in the base by a constant": ("h = 0.02\n", "p[a[0] - h, a[1], a[2] + h, a[3], a[4], a[5]]"),
}


@pytest.mark.parametrize("form", ["movel({})", "b = {}\nmovel(b)", "def go(g):\nmovel({})\nmovel(g)\nend\ngo(a)"])
@pytest.mark.parametrize("row", ABOVE)
def test_place_above_a_point_shares_its_correction(row, form, tmp_path):
    before, above = ABOVE[row]
    above = re.sub(r"\ba(?=\[|,)", "g", above) if "def" in form else above
    text = TCP + "a = {p1}\n" + before + "movej({q0})\n" + form.format(above) + "\nmovel(a)\n"
    found = corrected_ur(tmp_path, "a", text)
    told = corrected_ur(tmp_path, "b", TCP + "movej({q0})\nmovel({p1})\n")
    assert not uncorrected(found)
    assert np.nanmax(found.given_away_mm) > 0
    assert _poses(found.files["a.script"], 1)[0] == _poses(told.files["b.script"], 0)[-1]


PLANE = "p[0.1, -0.2, 0.05, 0, 0, 1.5707963267948966]"


IN_PLANE = {
    "written there": ("movel(pose_trans({plane}, {w}))\n", []),
    "a plane in a variable": ("f = {plane}\nmovel(pose_trans(f, {w}))\n", []),
    "both in variables": ("f = {plane}\nw = {w}\nmovel(pose_trans(f, w))\nmovel(pose_trans(f, {w}))\n", []),
    "a waypoint that PolyScope writes": (
        "global f={plane}\nmovej(get_inverse_kin(pose_trans(f, {w}), qnear={q1}))\n",
        [],
    ),
    "a pose in a variable": ("b = pose_trans({plane}, {w})\nmovel(b)\nmovej({q0})\nmovel(b)\n", []),
    "a plane that changes": ("f = {plane}\nf[0] = 0.2\nmovel(pose_trans(f, {w}))\n", [(3, "changed"), (5, "computed")]),
}  # fmt: skip


@pytest.mark.parametrize("row", IN_PLANE)
def test_point_in_a_plane_is_corrected_in_the_plane(row, tmp_path):
    """The plane is turned by a quarter about z, so its coordinates are those of the base in another order."""
    text, left = IN_PLANE[row]
    rig, files = ur_files({"b.script": TCP + "movej({q0})\nmovel({p1})\n"})
    x, y, z, *vector = _numbers(re.findall(r"p\[[^\]]*\]", files["b.script"])[1])
    inside = _in_plane((x, y, z), vector)
    told = _numbers(_poses(corrected_files(rig, tmp_path, files).files["b.script"], 2)[-1].decode())
    text = text.replace("{plane}", PLANE).replace("{w}", inside)
    found = corrected_ur(tmp_path, "a", TCP + "movej({q0})\n" + text)
    assert uncorrected(found) == left
    if not left:
        written = [pose.decode() for pose in _poses(found.files["a.script"], 2)]
        poses = [pose for pose in written if pose.startswith("p") and pose != PLANE]
        want = _numbers(_in_plane((told[0], told[1], told[2]), told[3:]))
        assert poses
        for pose in poses:
            assert _numbers(pose) == pytest.approx(want, abs=3e-8)
    assert PLANE in found.files["a.script"].decode()


def _numbers(text: str) -> list[float]:
    return [float(number) for number in re.findall(NUMBER, text)]


def _in_plane(place: tuple[float, float, float], vector: list[float]) -> str:
    x, y, z = place
    turned = Rotation.from_euler("z", -90, degrees=True) * Rotation.from_rotvec(vector)
    inside = [y + 0.2, -(x - 0.1), z - 0.05, *turned.as_rotvec()]
    return f"p[{', '.join(f'{value:.12f}' for value in inside)}]"


@pytest.mark.parametrize("name", ["a.urp", "A.URP", "b.tp", "B.TP"])
def test_binary_program_is_refused_with_the_form_to_give(name, tmp_path):
    path = tmp_path / name
    path.write_bytes(b"\x1f\x8b")
    with refused("program.invalid", "a known kind of robot program") as error:
        program_texts(path)
    assert re.search(r"\.(script|ls)", error.value.remedy)
