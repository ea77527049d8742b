"""The trigger in simulated time: what a robot does for minutes, and the recordings that it makes of it."""

import math

import pytest

from daq.acquisition.stream_buffer import PretriggerBuffer, samples_of
from daq.protocol.conversation import NO_TIME, Sample
from daq.recording.automatic import Command, StartRun, StopRun, Trigger
from rigs.schema.declared_tests import Rule

S = 1_000_000_000
HOME = (0.0, 10.0, 20.0, 30.0, 40.0, 50.0)
NAN = math.nan


def rule(test: str = "yaw", direction: str | None = "cw", still_s: float = 2.0, **when: object) -> Rule:
    return Rule.model_validate({"when": when, "test": test, "direction": direction, "still_s": still_s})


CW, ACW = rule(signal=1), rule(direction="acw", signal=2)


class Robot:
    """Speaks at 100 Hz; moves its first joint when told to."""

    def __init__(self, *rules: Rule) -> None:
        self.trigger = Trigger(rules)
        self.now_ns = 7 * S
        self.q1 = 0.0
        self.did: list[Command] = []

    def does(self, seconds: float, *signal: float, deg_s: float = 0.0) -> list[Command]:
        """Command of the trigger for these readings."""
        self.did = []
        for _ in range(round(seconds * 100)):
            self.now_ns += S // 100
            self.q1 += deg_s / 100
            values = (self.q1, *HOME[1:], *signal)
            self.did += self.trigger.feed(Sample(values, NO_TIME, self.now_ns, self.now_ns, 60))
        return self.did

    def silent(self, seconds: float) -> list[Command]:
        self.now_ns += round(seconds * S)
        return self.trigger.tick(self.now_ns)

    def ago(self, command: Command) -> float:
        return (self.now_ns - command.at_ns) / S


def test_a_signal_starts_and_its_end_and_a_stand_stop():
    robot = Robot(CW, ACW)
    assert robot.does(5, 0) == []
    (start,) = robot.does(20, 1, deg_s=10)
    assert start.rule is CW and robot.ago(start) == pytest.approx(19.99)
    assert robot.does(1.9, 0) == []
    (stop,) = robot.does(1, 0)
    assert stop.in_order and "stands still" in stop.why
    assert robot.does(60, 0) == []


def test_robot_at_rest_before_the_signal_ended_has_time():
    robot = Robot(CW)
    robot.does(1, 0)
    robot.does(5, 1, deg_s=10)
    assert robot.does(30, 1) == []  # it may stand at a target for as long as it likes
    robot.does(3, 0)
    assert [robot.ago(command) for command in robot.did] == [pytest.approx(3 - 0.01 - 2.0, abs=0.011)]


def test_a_robot_that_drives_on_ends_the_run_too():
    robot = Robot(CW)
    robot.does(1, 0)
    robot.does(5, 1, deg_s=10)
    assert robot.does(9.5, 0, deg_s=10) == []
    (stop,) = robot.does(1, 0, deg_s=10)
    assert "ended 10 s ago" in stop.why


def test_the_next_lap_ends_the_one_before():
    robot = Robot(CW, ACW)
    robot.does(1, 0)
    robot.does(5, 1, deg_s=10)
    stop, start = robot.does(5, 2, deg_s=-10)
    assert stop.in_order and start.rule is ACW
    assert stop.at_ns == start.at_ns
    robot.does(0.5, 0, deg_s=10)
    stop, start = robot.does(5, 2, deg_s=10)
    # the same again is a new lap
    assert start.rule is ACW


def test_outputs_that_switch_one_after_the_other_are_one_change():
    robot = Robot(rule(signal=3), CW)
    robot.does(1, 0)
    assert robot.does(0.05, 1) == []
    (start,) = robot.does(1, 3)
    assert start.rule.when.signal == 3


def test_a_signal_that_only_flickers_neither_starts_nor_ends():
    robot = Robot(CW)
    robot.does(1, 0)
    for _ in range(20):
        assert robot.does(0.05, 1) + robot.does(0.3, 0) == []
    assert len(robot.does(3, 1)) == 1
    for _ in range(20):
        assert robot.does(0.05, 0) + robot.does(0.3, 1) == []


@pytest.mark.parametrize("before", [[1], [NAN, 1]])
def test_a_signal_that_is_on_when_first_heard_is_no_start(before):
    robot = Robot(CW)
    assert [command for value in before for command in robot.does(5, value, deg_s=3)] == []
    assert robot.trigger.signal == 1
    robot.does(1, 0)
    assert len(robot.does(5, 1)) == 1


def test_an_unknown_signal_changes_nothing():
    robot = Robot(CW)
    robot.does(1, 0)
    robot.does(1, 1, deg_s=1)
    assert robot.does(30, NAN) == []
    assert robot.does(5, 1, deg_s=1) == []


def test_a_robot_that_is_not_heard_any_more_ends_the_run():
    robot = Robot(CW)
    assert robot.silent(100) == []
    robot.does(1, 0)
    robot.does(1, 1, deg_s=1)
    assert robot.silent(9) == []
    (stop,) = robot.silent(2)
    assert not stop.in_order and "no data" in stop.why
    assert robot.silent(100) == []


def test_a_gap_does_not_hide_that_the_signal_changed():
    robot = Robot(CW)
    robot.does(1, 0)
    assert robot.silent(30) == []
    assert len(robot.does(1, 1)) == 1


def test_forgotten_rule_does_not_end():
    robot = Robot(CW)
    robot.does(1, 0)
    robot.does(5, 1)
    robot.trigger.reset()
    assert robot.does(5, 1) + robot.does(60, 0) == []
    assert len(robot.does(1, 1)) == 1


# --- Motion ---

ON, BACK = (5.0, *HOME[1:]), (-5.0, *HOME[1:])
MOVES = rule(from_deg=HOME, to_deg=ON), rule(direction="acw", from_deg=HOME, to_deg=BACK)


@pytest.mark.parametrize(("deg_s", "direction"), [(4, "cw"), (-4, "acw"), (0.5, "cw"), (60, "cw")])
def test_a_departure_starts_with_the_direction_it_takes(deg_s, direction):
    robot = Robot(*MOVES)
    assert robot.does(3) == []
    left_ns = robot.now_ns
    (start,) = robot.does(max(10, 4 / abs(deg_s)), deg_s=deg_s)
    assert start.rule.direction == direction
    assert abs(start.at_ns - left_ns) < 0.1 * S
    assert robot.does(1.9) == []
    (stop,) = robot.does(1)
    assert stop.in_order


def test_only_a_robot_at_rest_departs():
    robot = Robot(*MOVES)
    robot.q1 = -30
    assert robot.does(20, deg_s=5) == []  # it comes from elsewhere and passes


def test_a_robot_that_leaves_for_elsewhere_has_not_departed():
    robot = Robot(rule(from_deg=HOME, to_deg=ON))
    robot.does(2)
    assert robot.does(10, deg_s=-5) + robot.does(20, deg_s=5) == []
    assert robot.q1 == pytest.approx(50)


def test_two_laps_separated_by_a_stand_are_two_runs():
    robot = Robot(rule(from_deg=HOME, to_deg=ON))
    robot.does(2)
    assert [type(c) for c in robot.does(9, deg_s=4)] == [StartRun]
    assert robot.does(9, deg_s=-4) == []
    assert robot.does(0.5) == []
    assert [type(c) for c in robot.does(9, deg_s=4)] == [StopRun, StartRun]


def test_stops_at_targets_shorter_than_still_s_are_one_run():
    robot = Robot(rule("radial", None, 5, from_deg=HOME, to_deg=ON))
    robot.does(2)
    did = [command for _ in range(10) for command in (*robot.does(2, deg_s=5), *robot.does(4))]
    assert [type(command) for command in did] == [StartRun]
    assert [type(command) for command in robot.does(2)] == [StopRun]


def test_encoders_that_flicker_at_rest_stand_still():
    robot = Robot(CW)
    robot.does(1, 0)
    robot.does(1, 1, deg_s=5)
    stops = []
    for number in range(300):
        robot.q1 += 0.005 * (-1) ** number
        stops += robot.does(0.01, 0)
    assert [type(command) for command in stops] == [StopRun]


def test_a_robot_that_creeps_does_not_stand_still():
    robot = Robot(CW)
    robot.does(1, 0)
    robot.does(2, 1, deg_s=1)
    assert robot.does(9, 0, deg_s=0.05) == []


# --- What came before ---


def test_five_seconds_and_the_whole_last_round_are_at_hand():
    recent = PretriggerBuffer(["robot"])
    stamps = [number * S // 10 for number in range(1000)]
    samples = [Sample((1.0,), NO_TIME, at_ns, at_ns, 60) for at_ns in stamps]

    def since(at_ns: int) -> list[int]:
        return [sample.first_byte_ns for sample in samples_of(recent.since("robot", at_ns))]

    for first in range(0, 800, 10):
        recent.add("robot", samples[first : first + 10])
    assert since(0) == stamps[:800]  # a disk that was behind takes nothing away
    recent.trim()
    recent.add("robot", samples[800:])
    assert since(0) == stamps[740:]  # the round in which the five seconds begin is whole
    assert since(80 * S) == stamps[800:]
