"""Cells of the five makers: the text of their targets, and programs corrected for an arm with known errors.

In a program, {qN} are joint angles, and {pN} is the pose of the nominal arm at these angles, with the tool and in the
frame of the cell.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from analysis.apps.correct.corrected_program import CorrectedProgram, correct_program
from analysis.apps.correct.postures import ProgramPostures
from analysis.apps.correct.stated_frames import frames_of
from analysis.apps.correct.stated_points import computed_points
from analysis.apps.makers.configuration import configuration_of, turns
from analysis.robot.kinematics.arm import arm_of
from rigs.rig import Rig
from tests.worlds.arms.faulty_arm import flange_at, frame, known
from tests.worlds.arms.independent_arm import Array
from tests.worlds.interpreters.arms import rig_of

Files = dict[str, str]
Left = list[tuple[int, str]]
NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"


def corrected_cell(
    maker: str, directory: Path, files: Files, *stated: Sequence[str], **options: Any
) -> CorrectedProgram:
    """Files with the targets of a maker's cell, corrected with its tools and frames unless others are stated."""
    rig, filled = {"ur": ur_files, "kuka": kuka_files, "abb": abb_files, "fanuc": fanuc_files, "yaskawa": yaskawa_files,
                   "linuxcnc": linuxcnc_files}[maker](files)  # fmt: skip
    return corrected_files(rig, directory, filled, *(stated or STATED.get(maker, ())), **options)


def corrected_files(
    rig: Rig,
    directory: Path,
    files: Files,
    *stated: Sequence[str],
    ends: str = "\n",
    is_directory: bool = False,
    **options: Any,
) -> CorrectedProgram:
    """Corrected text of the first file, which is corrected together with the others, or of the directory."""
    write_files(directory, files, ends)
    return corrected(rig, directory if is_directory else directory / next(iter(files)), *stated, **options)


def write_files(directory: Path, files: Files, ends: str = "\n") -> None:
    for name, text in files.items():
        (directory / name).parent.mkdir(parents=True, exist_ok=True)
        (directory / name).write_bytes(text.replace("\n", ends).encode("latin-1"))


def corrected(
    rig: Rig,
    path: Path,
    tools: Sequence[str] = (),
    frames: Sequence[str] = (),
    scale: Sequence[float] | None = None,
    *,
    start: tuple[float, ...] | None = None,
    near: tuple[float, ...] | None = None,
    neutral: Sequence[str] = (),
    whole: bool = False,
) -> CorrectedProgram:
    wrong, stated = known(rig), frames_of(rig.robot, tools, frames, neutral)
    postures = ProgramPostures(start, near)
    return correct_program(computed_points(wrong), path, stated, scale, postures=postures, whole=whole)


def uncorrected(found: CorrectedProgram) -> Left:
    """The uncorrected points, except unused points."""
    return [(one.line, one.reason) for one in found.left if one.reason != "unused"]


def left_names(found: CorrectedProgram) -> list[tuple[str, str]]:
    return [(one.name, one.reason) for one in found.left if one.reason != "unused"]


def filled(files: Files, pose: Callable[[int], str], joints: Callable[[int], str], count: int) -> Files:
    """Files with {pN} and {qN} in place of numbers."""
    for k in range(count):
        files = {
            name: text.replace(f"{{p{k}}}", pose(k)).replace(f"{{q{k}}}", joints(k)) for name, text in files.items()
        }
    return files


def numbers_of(T: Array, order: str = "xyz") -> list[float]:
    """Place in mm, and turns about these axes in degrees."""
    return [*T[:3, 3], *Rotation.from_matrix(T[:3, :3]).as_euler(order, degrees=True)]


UR_TOOL = frame((0, 0, 145), Rotation.identity())
UR = [
    (0, -80, 100, -20, 80, 0),
    (10, -75, 95, -25, 70, 15),
    (14, -70, 95, -25, 70, 15),
    (20, -85, 105, -30, 85, -10),
    (25, -80, 100, -30, 85, -10),
    (-5, -82, 101, -21, 81, 3),
    (-8, -82, 101, -24, 81, 3),
    (10, -75, 95, -25, 70 - 140, 15 + 150),
]
"""The last one has the other wrist."""
TCP = "set_tcp(p[0,0,0.145,0,0,0])\n"
OTHER = "set_tcp(p[0,0,0.2,0,0,0])\n"


def ur_pose(T: Array) -> str:
    """As PolyScope writes it: twelve decimals, and no zero before the point."""
    values = [*(T[:3, 3] / 1e3), *Rotation.from_matrix(T[:3, :3]).as_rotvec()]
    return ", ".join(re.sub(r"^(-?)0\.", r"\1.", f"{value:.12f}") for value in values)


def ur_files(files: Files) -> tuple[Rig, Files]:
    rig = rig_of("ur10e")

    def joints(k: int) -> str:
        return "[" + ", ".join(repr(float(np.radians(angle))) for angle in UR[k]) + "]"

    def pose(k: int) -> str:
        return f"p[{ur_pose(flange_at(rig, np.radians(UR[k])) @ UR_TOOL)}]"

    return rig, filled(files, pose, joints, len(UR))


KUKA_TOOL = frame((0, 50, 200), Rotation.from_euler("ZYX", (10, 20, 0), degrees=True))
KUKA_BASE = frame((500, -100, 30), Rotation.from_euler("ZYX", (45, 0, 0), degrees=True))
KUKA = [
    (20, -80, 90, 30, 60, -20),
    (25, -75, 95, -20, 50, 40),
    (-30, -70, 100, 100, -55, 200),
    (-25, -75, 95, 95, -60, 190),
    (10, -60, 80, 10, 45, 5),
]
KUKA_STATED = (["1=0,50,200,0,20,10"], ["2=500,-100,30,0,0,45", "3=0"])
HEAD = "DEF a()\n$TOOL=TOOL_DATA[1]\n$BASE=BASE_DATA[2]\n"
NO_EXTERNAL = ",E1 0.0,E2 0.0"


def status_turn(rig: Rig, q_deg: Sequence[float]) -> tuple[int, int]:
    """S and T from the joint angles, for an arm whose elbow is far from stretched."""
    T = flange_at(rig, np.radians(q_deg))
    wrist = T[:3, 3] - 90 * T[:3, 2]
    front = np.cos(np.arctan2(wrist[1], wrist[0]) + np.radians(q_deg[0])) > 0
    assert abs(q_deg[2]) > 20
    status = int(not front) + 2 * (q_deg[2] > 0) + 4 * (q_deg[4] <= 0)
    return status, sum(1 << axis for axis, angle in enumerate(q_deg) if angle < 0)


def kuka_pose(rig: Rig, q_deg: Sequence[float]) -> str:
    X = np.linalg.inv(KUKA_BASE) @ flange_at(rig, np.radians(q_deg)) @ KUKA_TOOL
    S, T = status_turn(rig, q_deg)
    pairs = [f"{name} {value:.6f}" for name, value in zip("XYZABC", numbers_of(X, "ZYX"), strict=True)]
    return ",".join([*pairs, f"S {S}", f"T {T}"]) + NO_EXTERNAL


def kuka_joints(q_deg: Sequence[float]) -> str:
    return ", ".join(f"A{axis} {angle}" for axis, angle in enumerate(q_deg, start=1))


def kuka_files(files: Files) -> tuple[Rig, Files]:
    """{pN-E} does not name the external axes, {pN+E} has the first one at 150 mm, {pN bits} has S and T in bits, and
    {E6POS: pN} states the type."""
    rig = rig_of("kuka-kr-10-r1100-2")

    def target(named: re.Match[str]) -> str:
        kind, form, number, option = named.groups()
        q_deg = KUKA[int(number)]
        numbers = kuka_pose(rig, q_deg) if form == "p" else kuka_joints(q_deg)
        if option == "-E":
            numbers = numbers.removesuffix(NO_EXTERNAL)
        elif option == "+E":
            numbers += ", E1 150"
        elif option:
            numbers = re.sub(r"([ST]) (\d+)", lambda flag: f"{flag[1]} 'B{int(flag[2]):06b}'", numbers)
        return f"{{{kind or ''}{numbers}}}"

    form = re.compile(r"\{(E6POS: |E6AXIS: )?([pq])(\d)([-+]E| bits)?\}")
    return rig, {name: form.sub(target, text) for name, text in files.items()}


ABB_TOOL = frame((5, 0, 90), Rotation.from_euler("xyz", (0, 45, 0), degrees=True))
ABB = [(20, 10, 20, 30, 60, -40), (25, 15, 15, -30, 50, 100), (-30, 5, 25, -100, 55, 150), (40, -10, 10, 15, 70, 20)]


def quaternion(T: Array) -> str:
    return ",".join(f"{value:.9g}" for value in Rotation.from_matrix(T[:3, :3]).as_quat(scalar_first=True))


def robtarget_of(rig: Rig, q_deg: Sequence[float], base: Array, external: str = "9E+09") -> str:
    X = np.linalg.inv(base) @ flange_at(rig, np.radians(q_deg)) @ ABB_TOOL
    cf = [int(q_deg[axis] // 90) for axis in (0, 3, 5)]
    conf = ",".join(map(str, [*cf, int(q_deg[4] < 0)]))
    place = ",".join(f"{value:.6g}" for value in X[:3, 3])
    return f"[[{place}],[{quaternion(X)}],[{conf}],[{external},9E+09,9E+09,9E+09,9E+09,9E+09]]"


def tooldata(place: str = "5,0,90", name: str = "t", storage: str = "PERS") -> str:
    return f"{storage} tooldata {name}:=[TRUE,[[{place}],[{quaternion(ABB_TOOL)}]],[1,[0,0,50],[1,0,0,0],0,0,0]];"


def abb_files(files: Files) -> tuple[Rig, Files]:
    """{pN=V} and {qN=V} have the first external axis at V. {t} declares the tool of the cell, and
    {PERS h PLACE} a tool h with the same orientation."""
    rig = rig_of("abb-irb-120")

    def target(named: re.Match[str]) -> str:
        q_deg, external = ABB[int(named[2])], named[3] or "9E+09"
        if named[1] == "p":
            return robtarget_of(rig, q_deg, np.eye(4), external)
        return f"[[{','.join(map(str, q_deg))}],[{external},9E9,9E9,9E9,9E9,9E9]]"

    def fill(text: str) -> str:
        text = re.sub(
            r"\{([A-Z ]+) h ([^}]*)\}", lambda of: tooldata(of[2], "h", of[1]), text.replace("{t}", tooldata())
        )
        return re.sub(r"\{([pq])(\d)(?:=([^}]*))?\}", target, text)

    return rig, {name: fill(text) for name, text in files.items()}


def module_of(body: str, rest: str = "", data: str = "") -> Files:
    return {"a.mod": f"MODULE a\n{{t}}\n{data}\nPROC main()\n{body}ENDPROC\n{rest}ENDMODULE\n"}


FANUC_TOOL = frame((10, -20, 180), Rotation.from_euler("xyz", (0, 30, 10), degrees=True))
FANUC_USER = frame((700, 100, 50), Rotation.from_euler("xyz", (0, 0, 30), degrees=True))
FANUC = [(20, 10, -30, 5, -70, 30), (22, 12, -28, 8, -65, 40), (15, 14, -26, -12, 60, 170), (30, 5, -20, -20, 60, 200)]
FANUC_STATED = (["1=10,-20,180,0,30,10"], ["3=0"])


def fanuc_point(number: int, inside: str, frames: str) -> str:
    name = ':"PICK"' if number == 2 else ""
    return f"P[{number}{name}]{{\r\n   GP1:\r\n\t{frames}{inside}\r\n}};"


def fanuc_pose(rig: Rig, q_deg: Sequence[float], base: Array) -> str:
    q = np.radians(q_deg)
    T = np.linalg.inv(base) @ flange_at(rig, q) @ FANUC_TOOL
    (flip, up, front), counts = configuration_of(arm_of(rig.robot), q), [turns(float(angle)) for angle in q[3:]]
    letters = f"{'F' if flip else 'N'} {'U' if up else 'D'} {'T' if front else 'B'}"
    x, y, z, w, p, r = numbers_of(T)
    return (
        f"\t\tCONFIG : '{letters}, {', '.join(map(str, counts))}',\r\n"
        f"\tX ={x:10.3f}  mm,\tY ={y:10.3f}  mm,\tZ ={z:10.3f}  mm,\r\n"
        f"\tW ={w:10.3f} deg,\tP ={p:10.3f} deg,\tR ={r:10.3f} deg"
    )


def fanuc_joints(q_deg: Sequence[float]) -> str:
    one = [f"J{axis}={angle:10.3f} deg" for axis, angle in enumerate(q_deg, start=1)]
    return "\r\n\t" + ",\t".join(one[:3]) + ",\r\n\t" + ",\t".join(one[3:])


def fanuc_files(files: Files) -> tuple[Rig, Files]:
    """Listings with the points P[1] in joint angles, and P[2] and P[3] in frame 3, P[4] in frame 0, all in tool 1.

    P[9], if a line names it, has an extended axis at 150 mm.
    """
    rig = rig_of("fanuc-m-10ia")
    pose = fanuc_pose(rig, FANUC[1], np.eye(4))
    points = [
        fanuc_point(1, fanuc_joints(FANUC[0]), "UF : 0, UT : 1,\t"),
        fanuc_point(2, pose, "UF : 3, UT : 1,"),
        fanuc_point(3, fanuc_pose(rig, (18, 14, -26, 5, -60, 35), np.eye(4)), "UF : 3, UT : 1,"),
        fanuc_point(4, pose, "UF : 0, UT : 1,"),
    ]
    first = next(iter(files))
    if "P[9]" in files[first]:
        points.append(fanuc_point(9, "\tE1=   150.000  mm", "UF : 3, UT : 1,"))
    end = "/POS\n" + "\n".join(points).replace("\r", "") + "\n/END\n"
    return rig, {
        name: text if "/POS" in text else text + (end if name == first else "/POS\n/END\n")
        for name, text in files.items()
    }


def listing(*lines: str, head: str = "", name: str = "A") -> str:
    return f"/PROG  {name}\n{head}/MN\n" + "".join(f"{k:4d}:{line} ;\n" for k, line in enumerate(lines, start=1))


def selecting(*lines: str, head: str = "") -> str:
    """A listing that selects the frame and the tool of each position before the move to it."""
    frames = {"P[2]": "3", "P[3]": "3", "P[4]": "0"}
    with_them = []
    for line in lines:
        if (point := re.match(r"L (P\[\d\])", line)) and point[1] in frames:
            with_them += [f"UFRAME_NUM={frames[point[1]]}", "UTOOL_NUM=1"]
        with_them.append(line)
    return listing(*with_them, head=head)


J1, L2, L3, L4 = (
    "J P[1] 100% FINE",
    "L P[2] 200mm/sec FINE",
    "L P[3] R[2]mm/sec CNT50 ACC80",
    "L P[4] 200mm/sec FINE",
)
ZERO = [f"PR[5,{axis}]=0" for axis in range(1, 7)]

YASKAWA_TOOL = frame((0, 0, 150), Rotation.identity())
YASKAWA = [(20, 20, 15, 10, -65, -150), (25, 25, 10, -15, -70, -100), (-10, 15, 5, 20, -60, 30)]
YASKAWA_STATED = (["3=0,0,150,0,0,0"], ["4=0"])
STATED = {"kuka": KUKA_STATED, "fanuc": FANUC_STATED, "yaskawa": YASKAWA_STATED}


def yaskawa_pose(rig: Rig, q_deg: Sequence[float]) -> str:
    values = numbers_of(flange_at(rig, np.radians(q_deg)) @ YASKAWA_TOOL)
    return ",".join(f"{value:.{3 + k // 3}f}" for k, value in enumerate(values))


def yaskawa_files(files: Files, more: str = "") -> tuple[Rig, Files]:
    """Jobs; {pos} are the positions C1 and C2 in user frame 4, and C3 in the base, all in tool 3. {c3} is the pose of
    the last one, and {p20} are the positions of a job with this pose in the variable 20.

    more: further positions of the first job."""
    rig = rig_of("yaskawa-gp7")
    flags = configuration_of(arm_of(rig.robot), np.radians(YASKAWA[0]))
    form = f"{','.join(str(int(not flag)) for flag in flags)},0,0,0"
    poses = [yaskawa_pose(rig, YASKAWA[k]) for k in (1, 2)]
    pos = (
        f"//POS\n///NPOS 3,0,0,0,0,0\n///TOOL 3\n///POSTYPE USER\n///USER 4\n///RECTAN\n///RCONF {form}\n"
        f"C00001={poses[0]}\nC00002={poses[1]}\n///POSTYPE BASE\n///RECTAN\n///RCONF {form}\nC00003={poses[0]}\n"
        "{more}//INST\n///DATE 2026/01/21 16:46\n///ATTR SC,RW\n///GROUP1 RB1\nNOP\n"
    )
    head = pos.partition("C00001")[0]
    variable = f"{head}///POSTYPE BASE\n///RECTAN\n///RCONF {form}\nP00020={poses[0]}\n//INST\nNOP\n"
    files = {
        name: text.replace("{p20}", variable).replace("{p20 in tool 5}", variable.replace("TOOL 3", "TOOL 5"))
        for name, text in files.items()
    }
    texts = {name: text.replace("{pos}", pos).replace("{more}", more, 1) for name, text in files.items()}
    return rig, {name: text.replace("{more}", "").replace("{c3}", poses[0]) for name, text in texts.items()}


def job_of(*lines: str, name: str = "A", pos: str = "{pos}") -> str:
    return f"/JOB\n//NAME {name}\n{pos}" + "\n".join(lines) + "\nEND\n"


BARE = "//POS\n///NPOS 0,0,0,0,0,0\n//INST\nNOP\n"
M1, M2, M3 = "MOVJ C00001 VJ=10.00 PL=0", "MOVL C00002 V=100.0 CR=5.0", "MOVL C00003 V=100.0"

LINUXCNC = (
    (0, -80, 100, -20, 80, 0),
    (5, -75, 95, -25, 70, 15),
    (-5, -85, 105, -30, 75, -10),
    (3, -78, 98, -22, 72, 5),
)
LINUXCNC_HEAD = (
    "G21 G90 G49 G40\nG92.1\nG10 L2 P1 X100 Y-50 Z20 A0 B0 C0 R0\nG54\nM68 E3 Q1\nM66 E0 L0\nG1 {q0} F600\n"
    "M68 E3 Q0\nM66 E0 L0\n"
)


def g_words(values: Sequence[float]) -> str:
    return " ".join(f"{letter}{value:.7f}" for letter, value in zip("XYZABC", values, strict=True))


def linuxcnc_files(files: Files) -> tuple[Rig, Files]:
    """{pN} is the pose with the work offset of the head, and {mN} in machine coordinates."""
    rig = rig_of("ur10e")
    shift = frame((100.0, -50.0, 20.0), Rotation.identity())

    def target(named: re.Match[str]) -> str:
        q_deg = LINUXCNC[int(named[2])]
        if named[1] == "q":
            return g_words(q_deg)
        T = flange_at(rig, np.radians(q_deg))
        T = np.linalg.inv(shift) @ T if named[1] == "p" else T
        return g_words(numbers_of(T))

    return rig, {name: re.sub(r"\{([pqm])(\d)\}", target, text) for name, text in files.items()}
