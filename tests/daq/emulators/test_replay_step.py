import os
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import pytest

from daq.acquisition.capture_writer import ReplayMarks, out_of_step_line
from daq.emulators.played import AnsweringPlayer, Exchanges, StreamingPlayer
from daq.emulators.replay import ReplayedStream
from daq.emulators.timebase import Steps, Timebase
from daq.protocol.conversation import FaultKind
from daq.wire.capture import CaptureMark, Piece

MS = 1_000_000
HEAD = 100 * MS
"""The head start of the host."""
BEAR = 2 * MS


def came(at_ms: float, data: bytes) -> Piece:
    return Piece(round(at_ms * MS), "s", CaptureMark.CAME, data)


def asked(at_ms: float, data: bytes) -> Piece:
    return Piece(round(at_ms * MS), "s", CaptureMark.SENT, data)


def lost(at_ms: float) -> Piece:
    return Piece(round(at_ms * MS), "s", CaptureMark.LOST, b"")


def steps(*, of_asked: bool = True) -> Steps:
    return Steps(BEAR, asked=of_asked)


def speaking(pieces: Sequence[Piece], time: Timebase, kept: Steps, *, calls: bool = False) -> StreamingPlayer:
    return StreamingPlayer(pieces, time, kept, hangs_up=False, calls=calls)


def answering(pieces: Sequence[Piece], kept: Steps) -> AnsweringPlayer:
    """Answers of a replay whose capture began at 0."""
    time = Timebase()
    time.begin(-HEAD, 0)
    return AnsweringPlayer(Exchanges.of(pieces), time, kept, hangs_up=False)


ROUNDS = [piece for k in range(5) for piece in (asked(10 * k, b"?\r"), came(10 * k + 8, b"%d\r" % k))]
"""A gauge that is asked each 10 ms and answers 8 ms later."""


def answer_at(question_ms: float, kept: Steps) -> tuple[bytes, float]:
    device = answering(ROUNDS, kept)
    step = device.received(b"?\r", round(question_ms * MS))
    assert not step.send and step.wake_ns is not None
    return device.tick(step.wake_ns).send, step.wake_ns / MS


@pytest.mark.parametrize(
    ("question_ms", "answer", "answer_ms", "skipped"),
    [
        (-3, b"0\r", 8, 0),  # too early: the answer waits for its time
        (1, b"0\r", 8, 0),  # late, and the error of its time is borne: the host stays in step
        (20, b"2\r", 28, 2),
        (25, b"3\r", 38, 3),  # so late that the next one is nearer
    ],
)
def test_a_question_gets_the_answer_of_its_time(question_ms, answer, answer_ms, skipped):
    kept = steps()
    assert answer_at(question_ms, kept) == (answer, answer_ms)
    assert kept.skipped == skipped


def test_a_number_that_an_answer_repeats_is_that_of_the_question():
    device = answering([asked(0, b"\0\7read"), came(8, b"\0\7is 5"), lost(50)], steps())
    step = device.received(b"\1\2read", 0)
    assert step.wake_ns == 8 * MS and device.tick(8 * MS).send == b"\1\2is 5"


def test_a_question_that_was_never_captured_is_counted():
    kept = steps()
    assert not answering(ROUNDS, kept).received(b"!\r", 5 * MS).send and kept.otherwise == 1


def test_unrequested_answers_are_skipped():
    kept = steps()
    device = answering(ROUNDS, kept)
    asked_last = device.received(b"?\r", 10 * MS)
    assert asked_last.wake_ns == 18 * MS and device.tick(18 * MS).send == b"1\r"
    device.tick(60 * MS)
    assert device.is_finished and kept.skipped == 4


def test_two_streams_share_the_time_that_begins_with_the_first_word():
    time, kept = Timebase(), steps(of_asked=False)
    gauge = speaking([asked(5, b"go"), came(20, b"a"), came(30, b"b")], time, kept)
    robot = speaking([came(25, b"x")], time, steps(of_asked=False))
    assert robot.connected(0).send == b"" and not robot.begun
    begun = gauge.received(b"go", 1000 * MS)
    shift = 995 * MS + HEAD
    assert begun.wake_ns == shift + 5 * MS
    assert gauge.tick(shift + 5 * MS).wake_ns == shift + 20 * MS
    assert gauge.tick(shift + 20 * MS).send == b"a"
    assert robot.tick(shift + 21 * MS).wake_ns == shift + 25 * MS
    assert robot.tick(shift + 26 * MS).send == b"x" and robot.is_finished
    assert gauge.tick(shift + 30 * MS).send == b"b" and gauge.is_finished


def test_instrument_waits_for_a_request_up_to_a_limit():
    time, kept = Timebase(), steps(of_asked=False)
    time.begin(-HEAD, 0)
    robot = speaking([asked(0, b"go"), came(1, b"1")], time, kept)
    waits = robot.tick(10 * MS).wake_ns
    assert waits > 100 * MS
    assert robot.tick(waits).send == b"1" and kept.otherwise == 1


def test_calling_replay_begins_with_the_first_listener():
    time = Timebase()
    robot = speaking([came(4, b"1"), came(16, b"2")], time, steps(of_asked=False), calls=True)
    assert robot.connected(0).send == b"1" and time.shift_ns is None
    refused = speaking([came(4, b"1"), came(16, b"2")], time, steps(of_asked=False), calls=True)
    knocked = refused.connected(500 * MS)
    assert knocked.send == b"1" and knocked.wake_ns is not None
    refused.tick(knocked.wake_ns)
    assert time.shift_ns == 496 * MS + HEAD


def test_early_disconnection_restarts_the_replay():
    time, kept = Timebase(), steps(of_asked=False)

    def play(pieces: Sequence[Piece]) -> StreamingPlayer:
        return StreamingPlayer(pieces, time, kept, hangs_up=True, calls=False)

    gauge = speaking([asked(0, b"go"), came(3, b"a"), came(90, b"b")], time, steps(of_asked=False))
    connections = [came(0, b"1"), came(50, b"2"), lost(60)], [came(80, b"3"), lost(99)]
    heard = ReplayedStream([partial(play, one) for one in connections], partial(play, ()), time)
    gauge.received(b"go", -HEAD)
    assert heard().connected(0).send == b"1"
    assert gauge.tick(3 * MS).send == b"a"
    again = heard()  # before its second piece
    assert time.turn == 1 and time.shift_ns is None
    assert again.connected(1000 * MS - HEAD).wake_ns == 1000 * MS
    assert not gauge.tick(1003 * MS).send and not gauge.begun  # it waits to be told to go
    assert again.tick(1000 * MS).send == b"1" and again.tick(1050 * MS).send == b"2"
    assert again.tick(1060 * MS).hang_up
    following = heard()
    assert time.turn == 1 and following.connected(1061 * MS).wake_ns == 1080 * MS
    early = heard()  # left before its first word: it is kept
    assert time.turn == 1 and early.connected(1070 * MS).wake_ns == 1080 * MS
    assert early.tick(1080 * MS).send == b"3" and heard.is_finished


@pytest.mark.parametrize(("of_asked", "off_ms", "out"), [(True, 1, 0), (True, 3, 1), (False, 1, 0), (False, 3, 1)])
def test_too_large_delay_is_reported(of_asked, off_ms, out):
    told: list[float] = []
    kept = Steps(BEAR, asked=of_asked, out_of_step=told.append)
    for k in range(25):
        kept.record_delay(40 * k * MS, off_ms * MS)
    kept.record_delay(1000 * MS, 500 * MS)  # one that was held up
    for k in range(1, 25):
        kept.record_delay((1000 + 40 * k) * MS, 0)
    kept.judge()
    assert kept.seconds_out == len(told) == out
    assert told == [off_ms * MS] * out


def test_daemon_receives_inserted_bytes_completely(tmp_path):
    file = tmp_path / "marks"
    assert ReplayMarks(file).read_new() == []
    file.write_text(out_of_step_line("g1", 3e6))
    followed = ReplayMarks(file)
    followed.skip()
    assert followed.read_new() == []
    with file.open("a") as marks:
        marks.write(out_of_step_line("robot", -4.2e6) + "nonsense\n" + "g1 +7")
    ((stream, fault),) = followed.read_new()
    assert stream == "robot" and fault.kind is FaultKind.OUT_OF_STEP and "-4.2 ms" in fault.detail
    assert followed.read_new() == []
    with file.open("a") as marks:
        marks.write(".5\n")
    ((stream, fault),) = followed.read_new()
    assert stream == "g1" and "+7.5 ms" in fault.detail


def test_the_daemon_hears_a_replay_that_starts_again(tmp_path):
    file = tmp_path / "marks"
    file.write_text(5 * out_of_step_line("g1", 3e6))
    followed = ReplayMarks(file)
    followed.skip()
    file.write_text(4 * out_of_step_line("g2", 3e6))
    assert [stream for stream, _ in followed.read_new()] == ["g2"] * 4


def _endless(path: Path) -> None:
    path.write_bytes(b"1" * (2**20))
    with path.open("ab") as file:
        file.write(b"\n" + out_of_step_line("g1", 3e6).encode())


@pytest.mark.parametrize(
    ("make", "heard"),
    [
        (os.mkfifo, 0),
        (lambda path: path.symlink_to("/dev/zero"), 0),
        (lambda path: path.write_bytes(b"\xff\xfe\n" + out_of_step_line("g1", 3e6).encode()), 1),
        (_endless, 1),
    ],
    ids=["a FIFO", "a device", "not UTF-8", "a long line"],
)
def test_marks_that_another_program_wrote_do_not_hold_the_daemon_up(make, heard, tmp_path):
    file = tmp_path / "marks"
    make(file)
    followed = ReplayMarks(file)
    assert sum(len(followed.read_new()) for _ in range(3)) == heard
    followed.skip()
    assert followed.read_new() == []
