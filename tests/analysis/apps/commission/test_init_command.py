import contextlib
import shlex
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from typer.testing import CliRunner

from analysis.apps.commission import gauge_questions
from analysis.cli import app
from daq.discovery.attempts import FoundGauge
from daq.discovery.port_search import PortReport
from rigs.arms import load_arm
from rigs.load import load, parse
from rigs.schema.limits import Limit, shared_limit
from tests.support.bench import BIN
from tests.support.command_line import json_of, succeeded
from tests.support.live_terminal import Terminal
from tests.support.person import Person
from tests.support.unknown_cells import UnknownCell, cell_text, switched_on

QUICK = "--listen-s 0.3"


def command(words: str) -> list[str | Path]:
    return [BIN / "rig", *shlex.split(f"init {words}")]


def at_ports(unknown: UnknownCell) -> str:
    """Ptys are not among the ports that a computer lists."""
    return " ".join([*(f"--port {port}" for port in unknown.gauge_ports), *unknown.robot_is_named, QUICK])


@contextlib.contextmanager
def asking(words: str) -> Iterator[tuple[Terminal, Person]]:
    with Terminal(command(words), 80, 60, {}) as terminal:
        yield terminal, Person(terminal)


def init(folder: Path, words: str) -> str:
    """Run it without a terminal, and return what it prints."""
    return succeeded(f"init {words}", cwd=folder).stdout


def refused(folder: Path, words: str) -> str:
    """Run it without a terminal, and return the code of its failure; --json lists the devices here."""
    with contextlib.chdir(folder):
        error = CliRunner().invoke(app, ["init", *shlex.split(words)]).exception
    return error.code


@pytest.mark.parametrize(("gauges", "robot"), [("sylvac", "fanuc"), ("keyence", "ur")])  # test_first_hour has others
def test_cell_is_identified_and_its_rig_file_checked(tmp_path, gauges, robot):
    with switched_on(gauges, robot) as unknown:
        path = tmp_path / "cell.yaml"
        with asking(f"{path} {at_ports(unknown)}") as (terminal, person):
            person.answers("Robot: ", unknown.robot)
            person.asked("Push gauge 1")
            unknown.hand.mm["g2"] += 1.0  # it is the second one that is on the positive side
            person.asked("g1: ")
            person.asked("counts towards")
            person.asked("Push gauge 2")
            unknown.hand.mm["g1"] -= 1.0
            person.asked("g2: ")
            person.asked("counts away")
            person.answers("[50]:", "")
            person.answers("Arm: ", "ur10e")
            person.answers("Pose of ", "0,0,150,0,90,0")
            person.answers("5 times ", "")
            person.answers("Is the ", "")
            assert terminal.ended() == 0, terminal.text()
    rig, text = load(path)
    names = {name: gauge.port if gauges != "keyence" else f"#{gauge.channel}" for name, gauge in rig.gauges}
    first, second = unknown.gauge_ports if gauges != "keyence" else ("#1", "#2")
    assert names == {"g1": second, "g2": first}
    assert [gauge.counts for _, gauge in rig.gauges] == ["towards", "away"]
    assert rig.feedback.port == unknown.robot
    assert not rig.effects and "# " in text
    assert rig.limits.of("yaw", "circular_deviation_mm") == Limit(watch=0.125, fail=0.25)
    assert [file.name for file in tmp_path.iterdir()] == ["cell.yaml"]


@pytest.mark.parametrize(
    ("measured_by", "arm"),
    [("tracker", "ur5e"), ("tracker", "so-101"), ("tracker", "kuka-lbr-iiwa-14"), ("arm", "ur10e"), ("arm", "so-101")],
)
def test_robot_is_refused_if_the_table_contains_the_joints(measured_by, arm, tmp_path):
    words = f"--measured-by {measured_by} --arm {arm} --tool 0,0,90"
    assert refused(tmp_path, f"{words} --robot 192.168.1.20") == "usage"
    printed = init(tmp_path, f"{words} --robot none")
    assert "ready for: " in printed and "not possible" not in printed


@pytest.mark.parametrize(
    ("measured_by", "arm", "ball_mm", "more", "then"),
    [
        ("sockets", "so-101", "30,0,90", "", "q1_deg … q5_deg"),
        ("sockets", "ur10e", "0,0,120", "--robot none", "touches.csv"),
        ("tracker", "widowx-250", "0,0,90", "--tolerance-mm 0.2", "poses.csv"),
    ],
)
def test_tracker_and_sockets_need_no_gauges_and_any_arm(tmp_path, measured_by, arm, ball_mm, more, then):
    assert then in init(tmp_path, f"--measured-by {measured_by} --arm {arm} --tool {ball_mm} {more}")
    rig, text = load(tmp_path / "cell.yaml")
    assert not rig.gauges.recorded and rig.robot.axes == load_arm(arm).robot.axes
    if measured_by == "sockets":
        assert rig.tests.touch.ball_mm == tuple(map(float, ball_mm.split(",")))
    else:
        assert rig.robot.tool.xyz_mm == (0, 0, 90) and rig.limits.pose.rms_mm == shared_limit(0.2)
    assert ("touch:" in text) == (measured_by == "sockets")


def test_robot_that_guides_touches_is_found(tmp_path):
    with switched_on("sylvac", "ur") as unknown:
        words = f"--measured-by sockets --arm ur10e --tool 0,0,90 --robot {unknown.robot}"
        assert "record touch" in init(tmp_path, " ".join([words, *unknown.robot_is_named]))
    rig, _ = load(tmp_path / "cell.yaml")
    assert rig.feedback.interface == "ur_rtde" and not rig.gauges.recorded


def test_arm_of_five_axes_has_neither_gauges_nor_a_robot(tmp_path):
    assert refused(tmp_path, "--arm so-101") == "arm.invalid"
    assert refused(tmp_path, "--measured-by sockets --arm so-101 --robot 192.168.1.20") == "usage"


def test_options_answer_every_question_without_a_terminal(tmp_path):
    with switched_on("sylvac", "fanuc") as unknown:
        first, second = unknown.gauge_ports
        given = f"--robot {unknown.robot} --g1 {second} --g2 {first} --baseline-mm 40 --arm ur10e --tool 0,0,150,0,90,0"
        more = f"--key g1.counts=towards --circle-later --tolerance-mm 0.4 {QUICK}"
        printed = init(tmp_path, f"'My Cell.yaml' {given} {more}")
    rig, _ = load(tmp_path / "My Cell.yaml")
    assert rig.name == "my-cell" and [(gauge.port, gauge.offset_mm) for _, gauge in rig.gauges] == [
        (second, 20),
        (first, -20),
    ]
    assert rig.limits.of("repeatability", "bi_mm") == Limit(watch=0.2, fail=0.4)
    said = f"g1 is {second} (sylvac_opto_rs)", f"g2 is {first} (sylvac_opto_rs)", "--key g2.counts=towards"
    assert all(words in printed for words in (*said, "rigd 'My Cell.yaml'", "circle fit --live"))


def test_named_sensor_gets_its_keys(tmp_path):
    with switched_on("micro_epsilon", "ur", streaming=False) as unknown:
        first, _ = unknown.gauge_ports
        keys = "--key g1.interface=micro_epsilon_ild1420 --key g1.range_mm=10 --key feedback.rate_hz=125"
        given = " ".join([keys, *unknown.robot_is_named])
        init(tmp_path, f"cell.yaml --robot {unknown.robot} --g1 {first} {given} --arm ur10e --tool 0,0,150")
    rig, _ = load(tmp_path / "cell.yaml")
    assert rig.gauges.g1.interface == "micro_epsilon_ild1420" and rig.gauges.g1.range_mm == 10
    assert rig.feedback.interface == "ur_rtde" and rig.feedback.rate_hz == 125


def test_json_lists_the_devices_and_writes_nothing(tmp_path):
    with switched_on("keyence", "ur") as unknown:
        words = f"--robot {unknown.robot} {at_ports(unknown)} --port {tmp_path}/none"
        found = json_of(f"init {words}", cwd=tmp_path)
    assert not list(tmp_path.iterdir())
    assert [gauge["gauge"]["channel"] for gauge in found["ports"][0]["gauges"] if gauge["gauge"].get("channel")] == [2]
    assert found["ports"][1]["problem"]
    assert found["robots"][0]["joints_deg"] == pytest.approx([0, 10, 20, 30, 40, 50])


def test_json_without_a_robot_searches_for_none(tmp_path):
    assert json_of(f"init --robot none {QUICK}", cwd=tmp_path)["robots"] == []


QUESTIONS = [
    "Robot: its",
    "Push gauge 1",
    "Distance between",
    "Arm: ",
    "Pose of the ball on",
    "Allowed error",
    "Is the robot",
]


@pytest.mark.parametrize("question", QUESTIONS)
def test_interrupted_questionnaire_continues(tmp_path, question):
    answers = dict(zip(QUESTIONS, ["", "1", "", "ur10e", "0,0,150", "0.3", ""], strict=True))
    with switched_on("keyence", "ur") as unknown:
        answers["Robot: its"] = unknown.robot
        path = tmp_path / "cell.yaml"
        with asking(f"{path} {at_ports(unknown)}") as (terminal, person):
            for asked in QUESTIONS[: QUESTIONS.index(question)]:
                person.answers(asked, answers[asked])
            person.asked(question)
            if question == "Arm: ":
                terminal.type("\x04")  # Ctrl-D
            else:
                terminal.process.send_signal(signal.SIGINT)  # what Ctrl-C does
            assert terminal.ended() == 130
            assert not path.exists()
        with asking(f"{path} {at_ports(unknown)}") as (terminal, person):
            begin = QUESTIONS.index(question)
            for asked in QUESTIONS[begin:]:
                person.answers(asked, answers[asked])
            assert terminal.ended() == 0, terminal.text()
            assert (b"Continuing with" in terminal.received) == (begin > 0)
    assert load(path)[0].robot.name == "Universal Robots UR10e"
    assert [file.name for file in tmp_path.iterdir()] == ["cell.yaml"]


def test_wrong_answers_are_asked_again(tmp_path):
    path = tmp_path / "cell.yaml"
    with switched_on("keyence", "ur") as unknown, asking(f"{path} {at_ports(unknown)}") as (terminal, person):
        person.answers("Robot: its", "none")
        person.answers("cannot be none", "tcp://127.0.0.1:1")
        person.answers("connection refused", unknown.robot)
        person.answers("Push gauge 1", "7")
        person.answers("is not a remaining gauge", "2")
        person.answers("Distance", "-3")
        person.answers("is not a distance", "60")
        person.answers("Arm: ", "nonsense")
        person.answers("an arm", "ur10e")
        person.answers("Pose of ", "1,2")
        person.answers("is not x,y,z", "0,0,150,0,90,0")
        person.answers("Allowed error", "0,3")
        person.answers("an error", "-1")
        person.answers("an error", "0.3")
        person.answers("Is the robot", "perhaps")
        person.answers("is not a choice", "n")
        assert terminal.ended() == 0
    rig, _ = load(tmp_path / "cell.yaml")
    assert [gauge.channel for _, gauge in rig.gauges] == [2, 1] and rig.gauges.baseline_mm == 60
    assert rig.limits.of("radial", "band_mm") == Limit(watch=0.15, fail=0.3)


@pytest.mark.parametrize(
    ("given", "code"),
    [
        ("", "answer.missing"),
        ("--robot tcp://127.0.0.1:1", "robot.silent"),
        ("--g2 /dev/none", "usage"),
        ("--key nonsense", "usage"),
        ("--key g3.units=mm", "usage"),
        ("--key g1.units=[ --robot x", "rig_file.invalid"),
        ("--baseline-mm 5 --robot x", "rig_file.invalid"),
        ("--name 'My Cell' --robot x", "rig_file.invalid"),
        ("--key g1.interface=tesa_tt --robot x", "usage"),
        ("--robot none", "usage"),
        ("--measured-by tracker --port /dev/none", "usage"),
        ("--measured-by sockets --key g1.range_mm=9", "usage"),
        ("--measured-by tracker --radius-mm 300", "usage"),
        ("--measured-by sockets --arm ur5 --tool 0,0,0.09", "usage"),
    ],
)
def test_wrong_option_is_refused_and_nothing_is_written(tmp_path, given, code):
    assert refused(tmp_path, f"cell.yaml {given}") == code
    assert not list(tmp_path.iterdir())


def test_existing_file_and_link_are_left_alone(tmp_path):
    (tmp_path / "cell.yaml").write_text("mine")
    (tmp_path / "link.yaml").symlink_to(tmp_path / "nowhere")
    assert refused(tmp_path, "cell.yaml") == refused(tmp_path, "link.yaml") == "output.exists"
    assert (tmp_path / "cell.yaml").read_text() == "mine"
    assert refused(tmp_path, "none/cell.yaml") == "output.not_writable"


def test_file_created_meanwhile_is_left_alone(tmp_path):
    path = tmp_path / "cell.yaml"
    with switched_on("tesa", "ur") as unknown:
        (port,) = unknown.gauge_ports
        given = " ".join([f"--robot {unknown.robot}", *unknown.robot_is_named, f"--g1 {port} --arm ur10e"])
        with asking(f"{path} {given} --tool 0,0,150 {QUICK}") as (terminal, person):
            person.answers("Allowed error", "0")
            person.asked("Is the robot")
            path.write_text("mine")
            person.types("n")
            assert terminal.ended() == 3
    assert path.read_text() == "mine"


def test_two_gauges_need_names_without_a_terminal(tmp_path, monkeypatch):
    gauges = [gauge for _, gauge in parse(cell_text("keyence", "ur"), "unknown").gauges]
    found = tuple(FoundGauge(gauge, 1.0, 10.0, "requests") for gauge in gauges)
    port = gauges[0].port
    monkeypatch.setattr(gauge_questions, "search", lambda *_: [PortReport(port, "", found)])
    with switched_on("keyence", "ur") as unknown:
        given = " ".join(["cell.yaml --robot", unknown.robot, *unknown.robot_is_named, QUICK])
        for more in (f"--arm ur10e --port {port}", f"--g1 {port}"):
            assert refused(tmp_path, f"{given} {more}") == "rig_file.invalid"


def test_arm_file_without_a_build_is_asked_for_it(tmp_path):
    """Plays of half a degree are usual of hobby servos, and four faults of an industrial arm."""
    section = load_arm("so-101").text.replace("  build: servo\n", "")
    (tmp_path / "arm.yaml").write_text(f"robot:\n{section.partition('robot:')[2]}")
    words = "--measured-by sockets --arm arm.yaml --tool 30,0,90"
    init(tmp_path, f"{words} --build servo")
    assert load(tmp_path / "cell.yaml")[0].robot.build == "servo"
    assert "--build" in init(tmp_path, f"second.yaml {words}")
    assert load(tmp_path / "second.yaml")[0].robot.build == "light"
