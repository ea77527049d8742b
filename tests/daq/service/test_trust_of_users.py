import socket

import pytest

from daq import clock
from daq.service.trust import InstanceLock
from tests.support.refusals import refused


@pytest.mark.parametrize(
    ("port", "same"),
    [("tcp://localhost:15021", "tcp://127.0.0.1:15021"), ("tcp://Gauge.example:1", "TCP://gauge.EXAMPLE:1")],
)
def test_one_daemon_reads_a_gauge_however_its_port_is_written(port, same):
    first = InstanceLock.take_gauge("g1", port)
    with refused("gauge.in_use"):
        InstanceLock.take_gauge("g1", same)
    InstanceLock.take_gauge("g1", f"{port}0").release()
    first.release()
    InstanceLock.take_gauge("g1", same).release()


def test_a_serial_port_is_one_under_all_its_names(tmp_path):
    (tmp_path / "tty").write_bytes(b"")
    (tmp_path / "by-id").symlink_to(tmp_path / "tty")
    first = InstanceLock.take_gauge("g1", str(tmp_path / "tty"))
    with refused("gauge.in_use"):
        InstanceLock.take_gauge("g1", str(tmp_path / "by-id"))
    first.release()


def test_lock_that_is_bound_and_listens_a_moment_later_is_held(monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr(socket.socket, "listen", lambda _: None)
        first = InstanceLock.take_gauge("g1", "tcp://gauge:1")
    # private: the socket of the lock
    monkeypatch.setattr(clock, "sleep", lambda _: first._socket.listen())
    with refused("gauge.in_use"):
        InstanceLock.take_gauge("g1", "tcp://gauge:1")
    first.release()
