import re

import numpy as np
import pytest

from analysis.apps.makers.emulated import OperatorPause, RegisterOutput, Switched
from analysis.apps.makers.motion_plan import Hold, Signal, demand_lines, demand_of, start_of
from analysis.apps.makers.tool_paths import circular_path
from analysis.apps.makers.writing import feedback_note
from analysis.apps.programs.planned import plans_of
from analysis.robot.kinematics.arm import Array
from daq.robot_drivers import line_feed
from rigs.errors import FileError
from tests.support.changed_rigs import rig_with, shipped
from tests.support.refusals import refused
from tests.worlds.interpreters.driven import files_of, run

RULES = [
    {"when": {"signal": 1}, "test": "yaw", "direction": "cw"},
    {"when": {"signal": 2}, "test": "yaw", "direction": "acw"},
    {"when": {"signal": 3}, "test": "repeatability"},
]
LINES = {
    "interface": "line_feed",
    "port": "tcp://192.168.1.10:59002",
    "fields": ["t_ms", *(f"q{axis}_deg" for axis in range(1, 7)), "signal"],
}
SWITCHING = {"feedback": LINES, "automatic": {"rules": RULES}}
RTDE = {"interface": "ur_rtde", "port": "tcp://robot:30004"}


def test_a_rule_of_the_rig_file_gives_the_signal_and_takes_the_pause():
    rig = rig_with(feedback=RTDE | {"signal": {"outputs": [4, 9]}}, automatic={"rules": RULES})
    acw, cw = plans_of(rig, "yaw", 3.0)
    assert [step.value for step in acw.steps if isinstance(step, Signal)] == [2, 0]
    assert [step.value for step in cw.steps if isinstance(step, Signal)] == [1, 0]
    assert not any(isinstance(step, Hold) for step in acw.steps)
    events = run("ur", files_of("ur", acw), rig)
    assert [event for event in events if isinstance(event, Switched | OperatorPause)] == [
        Switched(4, False),
        Switched(9, True),
        Switched(4, False),
        Switched(9, False),
    ]


def test_a_test_without_a_rule_waits_for_a_person():
    rig = rig_with(feedback=RTDE | {"signal": {"outputs": [4, 9]}}, automatic={"rules": RULES})
    plan, _ = plans_of(rig, "roll", 3.0)
    assert any(isinstance(step, Hold) for step in plan.steps)
    assert not any(isinstance(step, Signal) for step in plan.steps)


def test_a_register_of_rtde_shows_the_signal():
    rig = rig_with(feedback=RTDE | {"signal": {"int_register": 24}}, automatic={"rules": RULES})
    events = run("ur", files_of("ur", plans_of(rig, "yaw", 3.0)[1]), rig)
    assert [event for event in events if isinstance(event, RegisterOutput)] == [
        RegisterOutput(24, 1),
        RegisterOutput(24, 0),
    ]


@pytest.mark.parametrize(("dialect", "names"), [("fanuc", (9, 10)), ("kuka", (9, 10)), ("yaskawa", (9, 10))])
def test_other_controllers_switch_the_outputs_that_were_named(dialect, names):
    rig = rig_with(**SWITCHING)
    (plan,) = plans_of(rig, "repeatability", 3.0, names)
    switched = [event for event in run(dialect, files_of(dialect, plan), rig) if isinstance(event, Switched)]
    assert [(event.output, event.on) for event in switched] == [(9, True), (10, True), (9, False), (10, False)]


def test_nothing_is_switched_that_was_not_named():
    rig = rig_with(**SWITCHING)
    for test, outputs in (("repeatability", (9,)), ("yaw", ())):
        with refused("output.invalid", "does not fit into"):
            plans_of(rig, test, 3.0, outputs)


@pytest.mark.parametrize(("dialect", "number"), [("ur", 18), ("fanuc", 0), ("yaskawa", 5000)])
def test_an_output_that_the_controller_does_not_have_is_refused(dialect, number):
    rig = rig_with(**SWITCHING)
    plan = plans_of(rig, "yaw", 3.0, (number, 1))[0]
    with pytest.raises(FileError, match=str(number)) as refused:
        files_of(dialect, plan)
    assert refused.value.code == "output.invalid"


def test_the_lines_that_karel_prints_are_read_by_the_line_feed():
    rig = rig_with("paper-fanuc", **SWITCHING)
    files = files_of("fanuc", plans_of(rig, "yaw", 3.0, (9, 10))[0])
    text = files["RIGFEED.KL"]
    assert "$HOSTS_CFG[3].$SERVER_PORT', 59002" in text
    assert re.findall(r"IF DOUT\[(\d+)\] THEN\s+signal = signal \+ (\d+)", text) == [("9", "1"), ("10", "2")]
    host = line_feed.host(rig.feedback)
    host.connected(0)
    (sample,) = host.received(printed(text), 1_000_000).items
    assert sample.values == (10.5, 11.5, 12.5, 13.5, 14.5, 15.5, 2.0) and sample.device_time_s == 0.123


def test_a_condition_that_karel_cannot_print_is_refused():
    feedback = {**LINES, "fields": [*LINES["fields"], "speed_percent"]}
    rig = rig_with("paper-fanuc", feedback=feedback, automatic={"rules": RULES})
    with pytest.raises(FileError, match="speed_percent") as refused:
        files_of("fanuc", plans_of(rig, "yaw", 3.0, (9, 10))[0])
    assert refused.value.code == "rig_file.invalid"


def printed(text: str) -> bytes:
    """The line of a KAREL `WRITE`, whose items have a width and decimals after `::`; what CR sends is not known."""
    (items,) = re.findall(r"WRITE client \((.*)\)", text)
    line = ""
    item = r"'([^']*)'|CHR\((\d+)\)|(clock|signal|joints\[\d\])::(\d+)(?:::(\d+))?"
    assert re.fullmatch(rf"(?:{item})(?:, (?:{item}))*", items)
    for literal, code, name, width, decimals in re.findall(item, items):
        value = {"clock": 123, "signal": 2}.get(name) if name in ("clock", "signal") else None
        if name.startswith("joints"):
            value = 9.5 + int(name[7])
        character = chr(int(code)) if code else literal
        line += character if value is None else f"{value:{width}.{decimals or 0}f}"
    return line.encode()


@pytest.mark.parametrize(
    ("dialect", "feedback", "words"),
    [
        ("kuka", {"interface": "kuka_rsi", "port": "udp://192.168.1.5:49152"}, ("RSI_ON(#RELATIVE)", "RSI_OFF()")),
        ("abb", {"interface": "abb_egm", "port": "udp://192.168.1.5:6510"}, ("EGMStreamStart", "EGMStreamStop")),
    ],
)
def test_the_program_starts_the_feedback_of_its_maker(dialect, feedback, words):
    rig = rig_with(feedback=feedback)
    files = files_of(dialect, plans_of(rig, "yaw", 3.0)[0])
    assert run(dialect, files, rig)
    assert all(any(word in text for text in files.values()) for word in words)
    assert "yourself" in feedback_note("yaskawa", rig.feedback)


def test_a_circle_that_the_robot_cannot_drive_is_refused_before_anything_is_written():
    tests = shipped()["tests"]
    tests["hemisphere"]["centre_mm"] = [-1800, -200, 0]
    with refused("path.impossible", "of reach or limits, first target"):
        plans_of(rig_with(tests=tests), "radial", 3.0)


def test_the_turns_of_the_wrist_are_reported():
    rig = rig_with()
    plan = plans_of(rig, "yaw", 3.0)[0]
    demand = demand_of(plan)
    lines = demand_lines(plan, demand, [axis.name for axis in rig.robot.axes])
    (turning,) = [line for line in lines if line.startswith("wrist 3")]
    ways = 2 * 2 - 1
    assert f"{ways * 384 / 360:.1f} turns " in turning
    assert demand.distance_mm == pytest.approx([70, 70], abs=1e-3)


@pytest.mark.parametrize("direction", [0, 1])
@pytest.mark.parametrize("turns", [0, -1])
def test_wrist_that_unwinds_before_a_lap_is_reported(direction, turns):
    rig = rig_with()
    posture = (*rig.tests.circle.posture_deg[:5], rig.tests.circle.posture_deg[5] + 360 * turns)
    circle = rig.tests.circle.model_copy(update={"posture_deg": posture})
    plan = plans_of(rig.model_copy(update={"tests": rig.tests.model_copy(update={"circle": circle})}), "yaw", 3.0)[
        direction
    ]
    start = f"wrist 3 starts at {np.degrees(start_of(plan).q[5]):z.0f}°"
    lines = [
        line
        for line in demand_lines(plan, demand_of(plan), [axis.name for axis in rig.robot.axes])
        if "unwinds" in line
    ]
    assert [start in line for line in lines] == [True] * abs(turns)


def test_opposite_targets_are_joined_over_the_side_to_which_the_tool_leans():
    tests = shipped()["tests"]
    tests["repeatability"] = {"targets": [26, 32], "rounds": 1}  # 0° and 180° on the outermost ring
    plan = plans_of(rig_with(tests=tests), "repeatability", 3.0)[0]
    demand = demand_of(plan)
    assert demand.distance_mm == pytest.approx([397, 403], abs=0.01) and demand.removals == 0


def test_arc_takes_the_long_way_through_its_middle():
    def at(deg: float) -> Array:
        T = np.eye(4)
        T[:3, 3] = 100 * np.array([np.cos(np.radians(deg)), np.sin(np.radians(deg)), 0]) + [5, 6, 7]
        return T

    way = circular_path(at(0), at(150)[:3, 3], at(300), speed_mm_s=20.0)
    assert way.seconds == pytest.approx(np.radians(300) * 100 / 20)
    assert np.linalg.norm(way.poses[:, :3, 3] - [5, 6, 7], axis=1) == pytest.approx(100)
    assert way.poses[len(way.poses) // 2, :3, 3] == pytest.approx(at(150)[:3, 3])
