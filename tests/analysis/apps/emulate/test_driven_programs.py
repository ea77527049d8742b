"""The emulated robot drives what `rig program` wrote, with an arm whose faults its controller does not know.

Judged from the outside: where the tool went follows from the commanded angles by an arm that is multiplied out apart
from the product, before and after what `rig correct` wrote has been entered.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from analysis.apps.correct import correction_report
from analysis.apps.correct.correct_rig import correct_rig
from analysis.apps.emulate.pendant import Pendant
from analysis.apps.emulate.robot import Trace
from analysis.apps.makers.motion_plan import demand_of
from analysis.apps.makers.writing import programs_of, write_programs
from analysis.apps.programs.planned import plans_of
from analysis.robot.geometry.driven_programs import circle_program
from rigs.effects import JointOffset, LinkGeometry
from rigs.errors import FileError
from rigs.load import load
from rigs.rig import Rig
from rigs.schema.vocabulary import DrivenTest, MakerName
from tests.support.changed_rigs import rig_with, shipped
from tests.support.refusals import refused
from tests.support.written_files import contents
from tests.worlds.arms.faulty_arm import flange_at, found, frame
from tests.worlds.arms.independent_arm import Array, Wrong, none
from tests.worlds.interpreters.arms import pose_of, rig_of

CASES = [
    ("ur", "ur10e"),
    ("fanuc", "paper-fanuc"),
    ("kuka", "kuka-kr-10-r1100-2"),
    ("abb", "abb-irb-120"),
    ("yaskawa", "yaskawa-gp7"),
]
LENGTHS = ("ur", "fanuc", "kuka")
"""Makers at whose controllers lengths can be entered."""
ZERO_2_DEG, ZERO_4_DEG, A2_MM = -0.08, 0.05, 0.6


@dataclass(frozen=True)
class Cell:
    hidden: Rig
    programs: Path
    wrong: Wrong
    maker: MakerName

    def pendant(self) -> Pendant:
        return Pendant(self.hidden, self.programs, self.maker)


def cell(maker: MakerName, name: str, folder: Path, test: DrivenTest = "yaw") -> Cell:
    rig = rig_of(name).model_copy(update={"effects": ()})
    effects = [
        JointOffset(axis=2, offset_deg=ZERO_2_DEG, found=found(offset_deg=0.002)),
        JointOffset(axis=4, offset_deg=ZERO_4_DEG, found=found(offset_deg=0.002)),
    ]
    wrong = none()
    wrong.offset[[1, 3]] = np.radians([ZERO_2_DEG, ZERO_4_DEG])
    if maker in LENGTHS:
        effects.append(LinkGeometry(axis=3, field="a", delta=A2_MM, found=found(delta=0.02)))
        wrong.a[2] = A2_MM
    write_programs(maker, programs_of(maker, [(plan, demand_of(plan)) for plan in plans_of(rig, test, 3.0)]), folder)
    return Cell(rig.model_copy(update={"effects": tuple(effects)}), folder, wrong, maker)


def corrections(cell: Cell, folder: Path) -> Path:
    written = correction_report.write(correct_rig(cell.hidden, None, cell.maker), folder)
    return next(path for path in written if path.name == "corrections.yaml")


def off_mm(cell: Cell, trace: Trace, more_deg: Array) -> Array:
    """How far (n,) mm from its circle the tool really was from the second arc on; the joints read more_deg (6,) more
    than the links of the real arm stand at."""
    circle, tool = cell.hidden.tests.circle, pose_of(cell.hidden.robot.tool)
    base = pose_of(cell.hidden.robot.base)
    rows = np.arange(np.searchsorted(trace.t_s, trace.end_s / 8), len(trace.q), 40)
    T_tool = frame(tool.place, tool.turn)
    places = np.array(
        [(flange_at(cell.hidden, q, cell.wrong) @ T_tool)[:3, 3] for q in trace.q[rows] - np.radians(more_deg)]
    )
    from_ball = base.turn.apply(places) + base.place - circle.centre_mm
    normal = np.array(circle.normal) / np.linalg.norm(circle.normal)
    height = from_ball @ normal
    radius = np.linalg.norm(from_ball - height[:, None] * normal, axis=1)
    return np.hypot(radius - circle.radius_mm, height)


@pytest.mark.parametrize(("maker", "name"), [case for case in CASES if case[0] != "ur"])  # lengths cannot be entered
def test_entered_corrections_bring_the_tool_onto_the_circle(maker, name, tmp_path):
    here = cell(maker, name, tmp_path / "programs")
    file = corrections(here, tmp_path / "found")
    pendant = here.pendant()
    program = plans_of(here.hidden, "yaw", 3.0)[0].name
    before = pendant.trace(program)
    entries = contents(file)["controller"]["entries"]
    more_deg = np.zeros(6)
    for one in entries:
        more_deg[one["axis"] - 1] += one["reading_deg"]
    count, more_rad = pendant.enter(file)
    assert count == len(entries) >= 2
    np.testing.assert_allclose(np.degrees(more_rad), more_deg, atol=1e-7)
    after = pendant.trace(program)
    places = [pose_place(here.hidden, q) for q in after.q[2000:2010]]
    speeds_mm_s = np.linalg.norm(np.diff(places, axis=0), axis=1) / np.diff(after.t_s[2000:2010])
    assert speeds_mm_s == pytest.approx(here.hidden.tests.circle.speed_mm_s, rel=1e-3)
    assert off_mm(here, before, np.zeros(6)).max() > 0.2
    # The decimals of a job (0.001 mm) and the six digits of the entries are what is left.
    assert off_mm(here, after, more_deg).max() < (5e-3 if maker == "yaskawa" else 1e-3)
    wave = [float(np.ptp(trace.g_mm[len(trace.g_mm) // 8 :], axis=0).max()) for trace in (before, after)]
    assert wave[0] > 0.1 and wave[1] < 0.02 * wave[0]  # what the gauges read of it


@pytest.mark.parametrize(("maker", "name"), CASES)
def test_program_drives_the_joints_of_its_plan(maker, name, tmp_path):
    here = cell(maker, name, tmp_path)
    trace = here.pendant().trace(plans_of(here.hidden, "yaw", 3.0)[1].name)
    q = circle_program(here.hidden, "cw").q
    np.testing.assert_allclose(trace.q[0], q[0], atol=1e-4 if maker == "yaskawa" else 1e-6)
    np.testing.assert_allclose([trace.q.min(axis=0), trace.q.max(axis=0)], [q.min(axis=0), q.max(axis=0)], atol=1e-4)


def pose_place(rig: Rig, q: Array) -> Array:
    tool = pose_of(rig.robot.tool)
    return (flange_at(rig, q) @ frame(tool.place, tool.turn))[:3, 3]


@pytest.mark.parametrize("maker", ["ur", "yaskawa"])
@pytest.mark.parametrize("test", ["radial", "repeatability"])
def test_targets_are_dwelt_at(maker, test, tmp_path):
    here = cell(maker, "ur10e", tmp_path, test)
    trace = here.pendant().trace(f"{test} ur10e")
    stands = np.flatnonzero((np.diff(trace.t_s) > 2.9) & (np.abs(np.diff(trace.q, axis=0)).max(axis=1) < 1e-12))
    plan = plans_of(here.hidden, test, 3.0)[0]
    assert len(stands) >= sum(type(step).__name__ == "Dwell" for step in plan.steps) - 1
    assert trace.g_mm.shape == (len(trace.t_s), 2) and np.ptp(trace.g_mm[stands]) < 3.0


def test_outputs_and_registers_are_the_signal(tmp_path):
    rules = [{"test": test, "direction": "acw", "when": {"signal": k}} for test, k in (("yaw", 2), ("roll", 1))]
    feedback = shipped()["feedback"]
    shown = {}
    for place in ({"outputs": [3, 9]}, {"int_register": 12}):
        rig = rig_with(feedback=feedback | {"signal": place}, automatic={"rules": rules})
        folder = tmp_path / str(len(shown))
        plans = plans_of(rig, "yaw", 3.0)
        write_programs("ur", programs_of("ur", [(plan, demand_of(plan)) for plan in plans]), folder)
        trace = Pendant(rig, folder).trace(plans[0].name)
        assert not trace.holds_s  # an automatic run waits for nobody
        shown[next(iter(place))] = trace.signals
        begin_s, end_s = next(t_s for t_s, value in trace.signals if value == 2.0), trace.signals[-1][0]
        assert 2.9 < begin_s < 3.1 and end_s == pytest.approx(trace.end_s - 3.0, abs=1e-6)
    assert [value for _, value in shown["int_register"]] == [2.0, 0.0]
    assert shown["outputs"][-1][1] == 0.0 and 2.0 in [value for _, value in shown["outputs"]]


_POSE = "p[0.5, 0.1, 0.4, 0, 0, 0]"
_MOVED = f"set_tcp({_POSE})\n  movej([0,-1.5,1.5,0,1,0])\n  "
_REJECTED = {
    "unknown function": "sing()",
    "no move": "sleep(1)",
    "move before the tool": "movej([0,0,0,0,0,0])",
    "out of reach": f"{_MOVED}movel(p[9, 0, 0, 0, 0, 0])",
    "beyond a joint limit": f"set_tcp({_POSE})\n  movej([10,0,0,0,0,0])",
    "pose in a joint move": f"set_tcp({_POSE})\n  movej({_POSE})",
    "joints in an arc": f"{_MOVED}movec([0,0,0,0,0,0], {_POSE})",
    "no position of an arm": f"{_MOVED}movel(p[1000, 0, 0, 0, 0, 0])",
}


@pytest.mark.parametrize("body", _REJECTED.values(), ids=_REJECTED)
def test_impossible_program_is_rejected(tmp_path, body):
    (tmp_path / "yaw.script").write_text(f"def a():\n  {body}\nend\na()\n")
    with pytest.raises(FileError) as error:
        Pendant(load("ur10e-cell")[0], tmp_path).trace("yaw")
    assert error.value.code in ("robot.refused", "path.impossible") and "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("name", "code"),
    [
        ("nix", "maker.unknown"),
        ("yaw", "maker.unknown"),
        ("lap", "usage"),
        ("yaw_roll", "usage"),
        ("yaw_fanuc", "robot.other"),
        ("/nowhere/yaw.script", "file.unreadable"),
    ],
)
def test_unknown_program_is_refused(tmp_path, name, code):
    for stem in ("lap", "yaw_roll"):
        (tmp_path / f"{stem}.script").write_text("def a():\n  \nend\na()\n")
    (tmp_path / "yaw_fanuc.LS").write_text("/PROG  A\n")
    with refused(code):
        Pendant(load("ur10e-cell")[0], tmp_path).trace(name)
