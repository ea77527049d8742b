"""Points of a script that reach a move through a routine, a variable or an expression, or do not reach one at all."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from analysis.apps.makers.reading import program_texts
from rigs.errors import FileError
from tests.analysis.apps.correct.programs.test_safe_programs import (
    OTHER,
    TCP,
    Left,
    corrected_files,
    uncorrected,
    ur_files,
)

_LISTED: dict[str, tuple[str, Left]] = {
    "of an own movel that computes with it": (
        "def movel(p):\np[2] = p[2] + 0.1\nservoj(get_inverse_kin(p))\nend\n" + TCP + "movej({q0})\nmovel({p1})\n",
        [(3, "not_literal"), (7, "handed")],
    ),
    "solved for joint angles": (
        TCP + "q = get_inverse_kin({p1})\nmovej({q0})\nmovej(q)\n",
        [(2, "computed"), (4, "not_literal")],
    ),
    "solved near joint angles": (
        TCP + "q = get_inverse_kin({p1}, qnear={q1})\nmovej({q0})\nmovej(q)\n", [(2, "computed"), (4, "not_literal")]
    ),
    "in a list": (
        TCP + "a = [{p1}, {p2}]\nmovej({q0})\nmovel(a[1])\n", [(2, "array"), (4, "computed")]
    ),
    "in a comparison": (TCP + "movej({q0})\nif point_near({p1}):\nsleep(1)\nend\n", [(3, "handed")]),
    "in a sum": (
        TCP + "a = pose_add(get_actual_tcp_pose(), {p1})\nmovej({q0})\nmovel(a)\n",
        [(2, "computed"), (4, "not_literal")],
    ),
    "returned by a routine": (
        "def goal():\nreturn {p1}\nend\n" + TCP + "movej({q0})\nmovel(goal())\n", [(2, "computed"), (6, "computed")]
    ),
    "of a thread with an argument": (
        "thread t(p):\nmovel(p)\nend\n" + TCP + "movej({q0})\nrun t({p1})\n", [(2, "not_literal"), (6, "computed")]
    ),
}  # fmt: skip


@pytest.mark.parametrize("row", _LISTED)
def test_a_pose_that_no_move_is_known_to_reach_is_listed(row: str, tmp_path: Path) -> None:
    text, left = _LISTED[row]
    rig, files = ur_files({"a.script": text})
    assert uncorrected(corrected_files(rig, tmp_path, files)) == left


_HANDED: dict[str, tuple[str, str, str]] = {
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


@pytest.mark.parametrize("row", _HANDED)
def test_a_point_handed_to_a_routine_is_corrected_as_if_written_there(row: str, tmp_path: Path) -> None:
    routine, calls, written = _HANDED[row]
    rig, files = ur_files({"a.script": routine + TCP + "movej({q0})\n" + calls})
    found = corrected_files(rig, tmp_path, files)
    rig, files = ur_files({"b.script": TCP + "movej({q0})\n" + written})
    told = corrected_files(rig, tmp_path, files)
    assert not uncorrected(found) and not uncorrected(told)
    assert sorted(set(_poses(found.files["a.script"], 0))) == sorted(set(_poses(told.files["b.script"], 0)))


_KEPT: dict[str, tuple[str, Left]] = {
    "that also computes with it": (
        "def go(p):\nx = p[0]\nmovel(p)\nend\n" + TCP + "movej({q0})\ngo({p1})\n", [(3, "not_literal"), (7, "handed")]
    ),
    "that assigns it": (
        "def go(p):\np = get_actual_tcp_pose()\nmovel(p)\nend\n" + TCP + "movej({q0})\ngo({p1})\n",
        [(3, "not_literal"), (7, "handed")],
    ),
    "defined twice": (
        "def go(p):\nmovel(p)\nend\ndef go(p):\nsleep(1)\nend\n" + TCP + "movej({q0})\ngo({p1})\n",
        [(2, "not_literal"), (9, "handed")],
    ),
    "called in two tools with one point": (
        "def go(p):\nmovel(p)\nend\n" + TCP + "a = {p1}\nmovej({q0})\ngo(a)\n" + OTHER + "go(a)\n",
        [(5, "several_frames")]
    ),
    "called with computed points, too": (
        "def go(p):\nmovel(p)\nend\n" + TCP + "movej({q0})\ngo({p1})\ngo(get_target_waypoint())\n", [(2, "not_literal")]
    ),
    "with a default": (
        "def go(p={p2}):\nmovel(p)\nend\n" + TCP + "movej({q0})\ngo()\n", [(1, "computed"), (2, "not_literal")]
    ),
}  # fmt: skip


@pytest.mark.parametrize("row", _KEPT)
def test_a_point_handed_to_a_routine_that_is_not_only_a_move_is_left(row: str, tmp_path: Path) -> None:
    text, left = _KEPT[row]
    rig, files = ur_files({"a.script": text})
    assert uncorrected(corrected_files(rig, tmp_path, files)) == left


_ABOVE = {
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
@pytest.mark.parametrize("row", _ABOVE)
def test_a_place_above_a_point_shares_its_correction(row: str, form: str, tmp_path: Path) -> None:
    before, above = _ABOVE[row]
    above = re.sub(r"\ba(?=\[|,)", "g", above) if "def" in form else above
    text = TCP + "a = {p1}\n" + before + "movej({q0})\n" + form.format(above) + "\nmovel(a)\n"
    rig, files = ur_files({"a.script": text})
    found = corrected_files(rig, tmp_path, files)
    rig, files = ur_files({"b.script": TCP + "movej({q0})\nmovel({p1})\n"})
    told = corrected_files(rig, tmp_path, files)
    assert not uncorrected(found)
    assert np.nanmax(found.given_away_mm) > 0
    assert _poses(found.files["a.script"], 1)[0] == _poses(told.files["b.script"], 0)[-1]


_NOT_ABOVE: dict[str, tuple[str, Left]] = {
    "by a number of the loop": (
        "i = 0\nmovel(a)\nwhile i < 3:\nmovel(pose_trans(a, p[0, 0, -0.01 * i, 0, 0, 0]))\ni = i + 1\nend\n",
        [(7, "offset")],
    ),
    "turned in the base": ("movel(a)\nmovel(pose_add(a, p[0, 0, 0.01, 0.1, 0, 0]))\n", [(5, "offset")]),
    "by a variable that changes": (
        "o = p[0, 0, -0.02, 0, 0, 0]\no[2] = -0.05\nmovel(a)\nmovel(pose_trans(a, o))\n",
        [(4, "changed"), (7, "offset")],
    ),
    "above a point that is computed with": (
        "b = pose_trans(a, p[0, 0, -0.02, 0, 0, 0])\nb[0] = 0.3\nmovel(b)\nmovel(a)\n",
        [(2, "changed"), (4, "computed"), (6, "not_literal")],
    ),
    "of coordinates in another order": (
        "movel(p[a[1], a[0], a[2], a[3], a[4], a[5]])\nmovel(a)\n", [(2, "changed"), (4, "computed")]
    ),
    "of an offset that a move reaches, too": (
        "o = p[0, 0, -0.02, 0, 0, 0]\nmovel(a)\nmovel(pose_trans(a, o))\nmovel(o)\n", [(4, "changed")]
    ),
}  # fmt: skip


@pytest.mark.parametrize("row", _NOT_ABOVE)
def test_a_place_above_a_point_that_is_not_known(row: str, tmp_path: Path) -> None:
    moves, left = _NOT_ABOVE[row]
    rig, files = ur_files({"a.script": TCP + "a = {p1}\nmovej({q0})\n" + moves})
    assert uncorrected(corrected_files(rig, tmp_path, files)) == left


_PLANE = "p[0.1, -0.2, 0.05, 0, 0, 1.5707963267948966]"
_IN_PLANE: dict[str, tuple[str, Left]] = {
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


@pytest.mark.parametrize("row", _IN_PLANE)
def test_a_point_in_a_plane_is_corrected_in_the_plane(row: str, tmp_path: Path) -> None:
    """The plane is turned by a quarter about z, so its coordinates are those of the base in another order."""
    text, left = _IN_PLANE[row]
    rig, files = ur_files({"b.script": TCP + "movej({q0})\nmovel({p1})\n"})
    x, y, z, *vector = _numbers(re.findall(r"p\[[^\]]*\]", files["b.script"])[1])
    inside = _in_plane((x, y, z), vector)
    told = _numbers(_poses(corrected_files(rig, tmp_path, files).files["b.script"], 2)[-1].decode())
    text = text.replace("{plane}", _PLANE).replace("{w}", inside)
    rig, files = ur_files({"a.script": TCP + "movej({q0})\n" + text})
    found = corrected_files(rig, tmp_path, files)
    assert uncorrected(found) == left
    if not left:
        written = [pose.decode() for pose in _poses(found.files["a.script"], 2)]
        poses = [pose for pose in written if pose.startswith("p") and pose != _PLANE]
        want = _numbers(_in_plane((told[0], told[1], told[2]), told[3:]))
        assert poses
        for pose in poses:
            assert _numbers(pose) == pytest.approx(want, abs=3e-8)
    assert _PLANE in found.files["a.script"].decode()


def _numbers(text: str) -> list[float]:
    return [float(number) for number in text.strip("p[]").split(",")]


def _in_plane(place: tuple[float, float, float], vector: list[float]) -> str:
    from scipy.spatial.transform import Rotation  # noqa: PLC0415

    x, y, z = place
    turned = Rotation.from_euler("z", -90, degrees=True) * Rotation.from_rotvec(vector)
    inside = [y + 0.2, -(x - 0.1), z - 0.05, *turned.as_rotvec()]
    return f"p[{', '.join(f'{value:.12f}' for value in inside)}]"


@pytest.mark.parametrize("name", ["a.urp", "A.URP", "b.tp", "B.TP"])
def test_a_binary_program_is_refused_with_the_form_to_give(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(b"\x1f\x8b")
    with pytest.raises(FileError) as refused:
        program_texts(path)
    assert refused.value.code == "program.unknown" and re.search(r"\.(script|ls)", refused.value.remedy)
