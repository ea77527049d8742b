from daq.protocol.conversation import Fault, FaultKind
from daq.protocol.framing import LIMIT, DelimitedLines, Message, Sized


def test_a_delimiter_cut_in_two_ends_a_line_too_long():
    frames = DelimitedLines(b"\r\n")
    (fault,) = frames.feed(b"x" * LIMIT + b"\r", 1)
    assert fault.kind is FaultKind.GARBLED
    assert frames.feed(b"\nM0\r\n", 2) == [Message(b"M0", 4, 2, 2)]
    assert not frames.pending


def test_a_stream_out_of_step_stays_so_until_cleared():
    frames = Sized(1, lambda head: 2 if head == b"a" else None)
    good, fault = frames.feed(b"a1?a2", 1)
    assert good == Message(b"a1", 2, 1, 1) and isinstance(fault, Fault)
    assert frames.feed(b"a3", 2) == [] and frames.pending
    frames.clear()
    assert frames.feed(b"a4", 3) == [Message(b"a4", 2, 3, 3)]
