"""Who may control a daemon without a token, and who reads a gauge already."""

from __future__ import annotations

import os
import socket
from pathlib import Path

import pytest

from daq.service import trust
from daq.service.trust import InstanceLock, may_use, tcp_user
from tests.support.refusals import refused

TABLE = """\
  sl  local_address rem_address   st tx_queue rx_queue tr tm->when retrnsmt   uid  timeout inode
   0: 0100007F:21FC 00000000:0000 0A 00000000:00000000 00:00000000 00000000     0        0 11 1
   1: 0100007F:9C40 0100007F:21FC 01 00000000:00000000 00:00000000 00000000  1001        0 12 1
   2: 0200007F:9C40 0100007F:21FC 01 00000000:00000000 00:00000000 00000000  1002        0 13 1
   3: 0100007F:9C40 0100007F:1F90 01 00000000:00000000 00:00000000 00000000  1003        0 14 1
"""


@pytest.mark.parametrize(
    ("client", "user"),
    [
        (("127.0.0.1", 40000), 1001),
        (("::ffff:127.0.0.2", 40000), 1002),
        (("127.0.0.1", 40001), None),
        (("192.168.1.5", 40000), None),
        (("::1", 40000), None),
        (("nonsense", 1), None),
    ],
)
def test_a_connection_is_of_the_user_whom_the_system_names(
    tmp_path: Path, client: tuple[str, int], user: int | None
) -> None:
    (tmp_path / "tcp").write_text(TABLE)
    assert tcp_user(client, 0x21FC, tmp_path / "tcp") == user


def test_this_process_sees_its_own_connection() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server, socket.create_connection(server.getsockname()) as client:
        assert tcp_user(client.getsockname(), server.getsockname()[1]) == os.geteuid()


def test_a_user_may_use_what_the_socket_allows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "rigd.sock"
    path.write_bytes(b"")
    owner = path.stat().st_uid
    assert may_use(0, path) and may_use(owner, path) and may_use(os.geteuid(), tmp_path / "none")
    assert not may_use(owner + 4321, path) and not may_use(os.geteuid() + 4321, tmp_path / "none")

    class Member:
        pw_gid, pw_name = 99999, "eve"

    class Group:
        gr_mem = ("eve",)

    monkeypatch.setattr(trust.pwd, "getpwuid", lambda user: Member)
    monkeypatch.setattr(trust.grp, "getgrgid", lambda group: Group)
    assert may_use(owner + 4321, path)
    monkeypatch.setattr(Group, "gr_mem", ())
    assert not may_use(owner + 4321, path)


@pytest.mark.parametrize(
    ("port", "same"),
    [("tcp://localhost:15021", "tcp://127.0.0.1:15021"), ("tcp://Gauge.example:1", "TCP://gauge.EXAMPLE:1")],
)
def test_one_gauge_is_read_by_one_daemon_however_its_port_is_written(port: str, same: str) -> None:
    first = InstanceLock.take_gauge("g1", port)
    with refused("gauge.in_use"):
        InstanceLock.take_gauge("g1", same)
    InstanceLock.take_gauge("g1", f"{port}0").release()
    first.release()
    InstanceLock.take_gauge("g1", same).release()


def test_a_serial_port_is_one_under_all_its_names(tmp_path: Path) -> None:
    (tmp_path / "tty").write_bytes(b"")
    (tmp_path / "by-id").symlink_to(tmp_path / "tty")
    first = InstanceLock.take_gauge("g1", str(tmp_path / "tty"))
    with refused("gauge.in_use"):
        InstanceLock.take_gauge("g1", str(tmp_path / "by-id"))
    first.release()
