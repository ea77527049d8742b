import time
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from daq.acquisition import capture_writer
from daq.wire import capture
from daq.wire.capture import HEAD, Capture, CaptureMark, Piece, read_capture
from tests.support.bench import PATIENCE_S
from tests.support.refusals import refused

PIECES = st.builds(
    Piece,
    st.integers(0, 2**62),
    st.sampled_from(["g1", "g1_g2", "robot"]),
    st.sampled_from(CaptureMark),
    st.binary(max_size=40),
)


@given(st.lists(PIECES))
def test_a_capture_reads_back_bit_for_bit(pieces):
    path = Path("capture")  # never made: the text goes to the reader by hand
    text = "\n".join([HEAD, *(piece.line() for piece in pieces), ""])
    assert read_text(path, text) == Capture(tuple(pieces), cut=False)


def read_text(path: Path, text: str) -> Capture:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(capture, "read_bytes", lambda *_: text.encode())
        return read_capture(path)


def test_truncated_line_is_reported_and_ignored():
    whole = Piece(5, "g1", CaptureMark.CAME, b"+0.1\r")
    assert read_text(Path("cut"), f"{HEAD}\n{whole.line()}\n9 g1 < +0.") == Capture((whole,), cut=True)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a,b\n1,2\n", "capture"),
        (f"{HEAD}\n5 g1 ? x\n", "'5 g1 ? x'"),
        (f"{HEAD}\n5 g1 < \\x4\n", "line 2"),
        (f"{HEAD}\n5 g1 < \\u1234\n", "line 2"),
        (f"{HEAD}\n5 g1 < ü\n", "line 2"),
    ],
)
def test_invalid_capture_names_the_line(text, said):
    with refused("file.invalid", "a capture") as caught:
        read_text(Path("log"), text)
    assert said in str(caught.value)


def test_a_missing_file_is_one_line(tmp_path):
    with refused("file.invalid", "No such file or directory"):
        read_capture(tmp_path / "none")


def test_oversized_or_failing_capture_ends_with_a_fault(tmp_path, monkeypatch, caplog):
    monkeypatch.setattr(capture_writer, "LARGEST", 3000)
    # private: the list holds minutes of a stalled disk
    monkeypatch.setattr(capture_writer, "_ROOM", 10)
    found = capture_writer.CaptureWriter(tmp_path / "log", [])
    for number in range(15):
        found.add("g1", CaptureMark.CAME, bytes(100) + str(number).encode())
    found.start()
    until = time.monotonic() + PATIENCE_S
    while "grown" not in caplog.text and time.monotonic() < until:
        if " ! 5\n" in (tmp_path / "log").read_text():
            found.add("g1", CaptureMark.SENT, bytes(1000))
        time.sleep(0.01)
    found.finish(20)
    capture = read_capture(tmp_path / "log")
    assert [piece.data[100:] for piece in capture.pieces[:10]] == [str(n).encode() for n in range(10)]
    assert Piece(capture.pieces[10].at_ns, "g1", CaptureMark.LEFT_OUT, b"5") == capture.pieces[10]
    assert caplog.text.count("grown") == 1
