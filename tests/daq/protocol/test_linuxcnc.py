from __future__ import annotations

import os
import select
import socket
import threading
import time

import pytest

import daq.feedback
from daq.apps.commission import rigfeed
from daq.protocol.conversation import Fault, FaultKind, Sample
from rigs.schema.feedback import LinuxCNC
from tests.support.simulated_conversation import Script

LINE = b"9595 10.000000 50.000000 -60.000000 10.000000 40.000000 20.000000 1 7.000000 0 \n"
"""Recorded from linuxcnc-uspace 2.9.0."""


def received(*lines: bytes) -> list[Sample | Fault]:
    script = Script(daq.feedback.host(LinuxCNC(interface="linuxcnc", port="tcp://127.0.0.1:5480")))
    for number, line in enumerate(lines):
        script.receive(line, number)
    return [item for item in script.taken() if isinstance(item, Sample | Fault)]


def changed(count: int, lost: int = 0, homed: int = 1) -> bytes:
    return LINE.replace(b"9595", b"%d" % count).replace(b" 0 \n", b" %d \n" % lost).replace(b" 1 7", b" %d 7" % homed)


def test_line_gives_joints_signal_and_servo_clock():
    (sample,) = received(LINE)
    assert isinstance(sample, Sample)
    assert sample.values == (10.0, 50.0, -60.0, 10.0, 40.0, 20.0, 7.0)
    assert sample.device_time_s == pytest.approx(9.595)


@pytest.mark.parametrize(
    ("lines", "count"),
    [
        ((changed(5), changed(9)), 3),  # lost after the sampler
        ((changed(5), changed(6, lost=3007)), 3007),  # lost by the sampler, whose numbers continue
        ((changed(5), b"overrun\n", changed(8)), 2),
        ((changed(9000), changed(0)), 1),  # restarted
    ],
)
def test_lost_samples_are_counted_and_a_restart_is_reported(lines, count):
    first, fault, last = received(*lines)
    assert isinstance(fault, Fault) and (fault.kind, fault.count) == (FaultKind.SKIPPED, count)
    assert isinstance(first, Sample) and isinstance(last, Sample)


@pytest.mark.parametrize(
    ("line", "kind"),
    [
        (changed(5, homed=0), FaultKind.DEVICE_ERROR),
        (LINE.replace(b"50.0", b"nan"), FaultKind.GARBLED),
        (LINE.replace(b" 7.000000", b""), FaultKind.GARBLED),
        (LINE.replace(b"50.000000", b"5e7"), FaultKind.GARBLED),
    ],
)
def test_positions_without_homing_and_damaged_lines_are_no_samples(line, kind):
    (fault,) = received(line)
    assert isinstance(fault, Fault) and fault.kind is kind


def test_served_client_gets_complete_lines_until_another_connects():
    lines, sampler = os.pipe()
    with socket.create_server(("127.0.0.1", 0)) as server:
        thread = threading.Thread(target=rigfeed.serve, args=(lines, server))
        thread.start()
        os.write(sampler, b"old 1\nol")
        while select.select([lines], [], [], 0)[0]:  # read before a client connects
            time.sleep(0.001)
        with socket.create_connection(server.getsockname()) as first:
            os.write(sampler, b"d 2\nnew\nha")
            assert set(iter(first.makefile("rb").readline, b"new\n")) <= {b"old 1\n", b"old 2\n"}
            with socket.create_connection(server.getsockname()) as second:
                while first.recv(100):
                    pass
                os.write(sampler, b"lf\n")
                assert second.recv(100) == b"half\n"
                os.close(sampler)
                thread.join()
    os.close(lines)
