import math
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from analysis.cli import app
from analysis.runs.recording_rule import rule_of
from daq.protocol.conversation import NO_TIME, Sample
from daq.recording.automatic import StartRun, StopRun, Trigger
from daq.store import RunWriter, new_manifest, read_run
from rigs.errors import FileError
from rigs.load import SHIPPED, parse
from rigs.problems import RigFileError
from rigs.schema.declared_tests import Automatic
from tests.support.refusals import refused

UR10E = (SHIPPED / "ur10e-cell.yaml").read_text()
SIGNAL = "  rate_hz: 500\n  signal: {outputs: [0, 1]}\n"


def told(automatic: str, text: str = UR10E.replace("  rate_hz: 500\n", SIGNAL)) -> list[str]:
    try:
        parse(f"{text}\n{automatic}\n", "cell.yaml")
    except RigFileError as error:
        return [str(problem) for problem in error.problems]
    return []


def test_the_example_of_the_documents_is_good():
    page = (Path(__file__).parents[3] / "docs" / "recording.md").read_text()
    (example,) = re.findall(r"```yaml\n(feedback: .*?)```", page, re.S)
    data = yaml.safe_load(UR10E) | yaml.safe_load(example)
    assert len(data["automatic"]["rules"]) == 3 and told("", yaml.safe_dump(data)) == []


def test_every_mistake_of_the_rules_is_reported():
    rules = """
automatic:
  rules:
    - {when: {sginal: 1}, test: yaw, direction: cw}
    - {when: {signal: 1}, test: yaw}
    - {when: {signal: 2}, test: radial, direction: cw}
    - {when: {signal: 3, from_deg: [0, 0, 0, 0, 0, 0], to_deg: [5, 0, 0, 0, 0, 0]}, test: roll, direction: cw}
    - {when: {from_deg: [0, 0, 0, 0, 0, 0]}, test: roll, direction: cw}
    - {when: {from_deg: [0, 0, 0, 0, 0, 0], to_deg: [1, 0, 0, 0, 0, 0]}, test: roll, direction: cw}
    - {when: {signal: 5}, test: pose, still_s: 0}
retention: {}"""
    problems = told(rules)
    words = [
        "signal?",
        "needs a direction",
        "no direction",
        "either signal, or",
        "and to_deg",
    ]
    words += [
        "distant posture",
        "'pose' is unknown",
        "at least 0.2",
        "days, gigabytes",
    ]
    for word in words:
        assert any(word in problem for problem in problems), (word, problems)
    assert all(problem.startswith("line ") for problem in problems) and len(problems) == len(words)


@pytest.mark.parametrize("event", ["signal: 1", "from_deg: [0, 0, 0, 0, 0, 0], to_deg: [5, 0, 0, 0, 0, 0]"])
def test_two_rules_for_one_event_are_refused(event):
    rules = ", ".join(f"{{when: {{{event}}}, test: {test}, direction: cw}}" for test in ("yaw", "roll"))
    (problem,) = told(f"automatic: {{rules: [{rules}]}}")
    assert "automatic: rules 1 and 2 " in problem


def test_rules_need_signals_and_gauges_of_the_cell():
    rules = "automatic: {rules: [{when: {signal: 1}, test: yaw, direction: cw}]}"
    (problem,) = told(rules, UR10E)
    assert "rule 1 waits" in problem
    one_gauge = yaml.safe_load(UR10E)
    del one_gauge["gauges"]["g2"]
    (problem,) = told(rules, yaml.safe_dump(one_gauge))
    assert "feedback" in problem and "two gauges" in problem


@pytest.mark.parametrize("signal", ["{}", "{outputs: [0], int_register: 3}", "{outputs: [1, 1]}", "{outputs: [18]}"])
def test_a_signal_has_one_place(signal):
    (problem,) = told("", UR10E.replace("  rate_hz: 500\n", f"  rate_hz: 500\n  signal: {signal}\n"))
    assert "feedback.signal" in problem


def lap(runs: Path, q1_deg: Sequence[float], signal: Sequence[float] = (), test: str = "yaw") -> Path:
    """A run of the robot at 100 Hz, with a direction whatever the test: rigd takes one."""
    joints = [f"q{axis}_deg" for axis in range(1, 7)]
    writer = RunWriter.create(
        runs,
        new_manifest(
            name="lap",
            test=test,
            direction="cw",
            rig_name="ur10e",
            rig_text=UR10E,
            operator="ada",
            streams={"robot": (*joints, "signal") if len(signal) else tuple(joints)},
        ),
    )
    writer.append("robot", samples(q1_deg, signal))
    writer.close("complete", "", {})
    return writer.path


def samples(q1_deg: Sequence[float], signal: Sequence[float] = ()) -> list[Sample]:
    shown = [(value,) for value in signal] or [()] * len(q1_deg)
    at = [10**9 + 10**7 * number for number in range(len(q1_deg))]
    return [
        Sample((q1, 10.0, 20.0, 30.0, 40.0, 50.0, *more), NO_TIME, at_ns, at_ns, 60)
        for q1, more, at_ns in zip(q1_deg, shown, at, strict=True)
    ]


STAND = np.zeros(100)
TURN = np.concatenate([STAND, np.linspace(0, 90, 900), np.full(300, 90.0)])
NIGHT = np.concatenate([TURN[:1000], np.full(200_000, 90.0), np.linspace(90, 80, 100), np.full(100, 80.0)])
STOPS = np.concatenate(
    [STAND, *(np.append(np.linspace(k, k + 10, 100), np.full(150, k + 10.0)) for k in range(0, 50, 10))]
)


@pytest.mark.parametrize(("q1_deg", "test", "still_s"), [(TURN, "yaw", 2.0), (STOPS, "radial", 3.0)])
def test_the_rule_of_a_run_knows_its_program_again(tmp_path, q1_deg, test, still_s):
    rule = rule_of(read_run(lap(tmp_path, q1_deg, test=test)))
    assert (rule.test, rule.direction, rule.still_s) == (test, "cw" if test == "yaw" else None, still_s)
    again = np.append(q1_deg + 0.01, np.full(400, q1_deg[-1] + 0.01))
    trigger = Trigger([rule])
    commands = [command for sample in samples(again) for command in trigger.feed(sample)]
    assert [type(command) for command in commands] == [StartRun, StopRun]
    assert commands[0].at_ns == pytest.approx(2e9, abs=1e8)
    trigger = Trigger([rule])
    assert [command for sample in samples(-again) for command in trigger.feed(sample)] == []


def test_the_rule_of_a_run_with_a_signal_waits_for_it(tmp_path):
    signal = np.concatenate([STAND, np.full(900, 7.0), np.full(100, math.nan), np.zeros(200)])
    rule = rule_of(read_run(lap(tmp_path, TURN, signal)))
    assert rule.when.signal == 7 and rule.when.from_deg is None


@pytest.mark.parametrize(
    ("q1_deg", "code"),
    [
        (STAND, "readings.unsuitable"),
        (TURN[100:], "readings.unsuitable"),
        (STAND[:0], "readings.unsuitable"),
        (NIGHT, "readings.unsuitable"),
    ],
)
def test_a_run_without_an_event_has_no_rule(tmp_path, q1_deg, code):
    with refused(code):
        rule_of(read_run(lap(tmp_path, q1_deg)))


def test_the_command_prints_a_section_for_the_rig_file(tmp_path):
    cw, radial = lap(tmp_path / "a", TURN), lap(tmp_path / "b", -STOPS, test="radial")
    done = CliRunner().invoke(app, ["automatic", str(cw), str(radial)])
    assert done.exit_code == 0 and told(done.stdout) == []
    assert len(Automatic.model_validate(yaml.safe_load(done.stdout)["automatic"]).rules) == 2
    twice = CliRunner().invoke(app, ["automatic", str(cw), str(cw)])
    assert isinstance(twice.exception, FileError) and "same event" in str(twice.exception)
