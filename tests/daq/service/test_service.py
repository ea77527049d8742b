import shutil
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from daq.store import read_run
from tests.support.bench import PATIENCE_S, Bench

ROOT = Path(__file__).parents[3]
UNIT = ROOT / "systemd" / "rigd@.service"


def test_systemd_hears_ready_watchdog_and_stopping(bench):
    address = bench.folder / "notify"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(address))
        manager.settimeout(PATIENCE_S)
        bench.env |= {"NOTIFY_SOCKET": str(address), "WATCHDOG_USEC": "2000000"}
        bench.start()
        assert manager.recv(4096).startswith(b"READY=1\nSTATUS=reading g1 on ")
        assert manager.recv(4096) == b"WATCHDOG=1"
        assert manager.recv(4096) == b"WATCHDOG=1"
        assert bench.signalled(signal.SIGTERM)[0] == 0
        heard = b""
        while heard != b"STOPPING=1":
            heard = manager.recv(4096)


@pytest.mark.skipif(not shutil.which("systemd-analyze"), reason="no systemd-analyze")
def test_the_unit_is_valid_and_hardened(tmp_path):
    unit = tmp_path / "rigd@cell.service"
    unit.write_text(UNIT.read_text().replace("/opt/rig/bin/rigd", sys.executable))
    done = subprocess.run(["systemd-analyze", "verify", unit], capture_output=True, text=True, check=False)
    assert done.returncode == 0 and not done.stderr, done.stderr
    command = ["systemd-analyze", "security", "--offline=true", "--no-pager", unit]
    rated = subprocess.run(command, capture_output=True, text=True, check=False).stdout
    exposure = float(rated.rsplit("exposure level", 1)[1].split(":")[1].split()[0])
    assert exposure <= 1.2
    assert f"rates it {exposure}." in (ROOT / "docs" / "service.md").read_text()


def test_the_unit_is_limited():
    told = dict(line.split("=", 1) for line in UNIT.read_text().splitlines() if "=" in line and line[0] != "#")
    assert told["IPAddressDeny"] == "any" and "IPAddressAllow" not in told
    assert told["MemoryMax"] and int(told["TasksMax"]) > 64 and int(told["LimitNOFILE"]) >= 1024


@pytest.mark.skipif(not shutil.which("systemd-sysusers"), reason="no systemd-sysusers")
def test_the_unit_runs_as_the_user_that_sysusers_makes(tmp_path):
    (tmp_path / "etc").mkdir()
    subprocess.run(["systemd-sysusers", f"--root={tmp_path}", UNIT.with_name("rig.sysusers")], check=True)
    name, _, uid, gid, _, home, shell = (tmp_path / "etc" / "passwd").read_text().strip().split(":")
    assert (name, home) == ("rig", "/var/lib/rig") and "nologin" in shell and uid != "0"
    groups = [line.split(":") for line in (tmp_path / "etc" / "group").read_text().splitlines()]
    assert {group: members for group, _, _, members in groups} == {"dialout": "rig", "rig": ""}
    assert gid in {number for group, _, number, _ in groups if group == "rig"}
    told = dict(line.split("=", 1) for line in UNIT.read_text().splitlines() if "=" in line and line[0] != "#")
    assert told["User"] == told["Group"] == "rig" and "DynamicUser" not in told


def test_the_group_may_read_a_run_and_use_the_socket(bench):
    bench.start(umask=0o027).all_reading()
    path = bench.record()
    bench.recorded(20)
    assert bench.run("rig", "record", "stop").returncode == 0
    made = {entry: entry.stat().st_mode & 0o077 for entry in (path, *path.iterdir(), bench.socket)}
    assert set(made.values()) == {0o040, 0o050, 0o060} and made[path] == 0o050, made


def _failing_daemon(bench: Bench, patch: str) -> Bench:
    """The daemon with an error in the program, which `patch` plants."""
    program = bench.folder / "rigd.py"
    program.write_text(f"import sys; sys.path.pop(0)\n{patch}\nfrom daq.service.rigd import main; main()")
    return bench.start(program=[sys.executable, program])


BROKEN_READER = """
import daq.feedback
from pathlib import Path
runs = Path(__file__).parent / "runs"
def break_down(self, data, now_ns, received=[0]):
    received[0] += any(runs.glob("*/manifest.json"))  # however long a busy computer takes to begin a recording
    return original(self, data, now_ns) if received[0] < 500 else self.no_such_thing
from daq.protocol.streamed import Streamed
original = Streamed.received
def host(feedback):
    import daq.robot_drivers.ur_rtde as ur
    conversation = ur.host(feedback)
    conversation.received = lambda data, now_ns: break_down(conversation, data, now_ns)
    return conversation
daq.feedback.host = host
"""
BROKEN_WRITER = """
from daq.recording.recorder import Recorder
take, rounds = Recorder._drain_buffers, []
def break_down(self, *, sync):
    rounds.append(self._current)
    if sync and len(list(filter(None, rounds))) == 4:
        raise TypeError("no such thing")
    return take(self, sync=sync)
Recorder._drain_buffers = break_down
"""


@pytest.mark.parametrize(
    ("patch", "thread", "error"),
    [(BROKEN_READER, "read robot", "AttributeError"), (BROKEN_WRITER, "write", "TypeError")],
    ids=["reader", "writer"],
)
def test_program_error_fails_the_run_and_ends_the_daemon(bench, patch, thread, error):
    _failing_daemon(bench, patch).all_reading()
    path = bench.record()
    _, said = bench.daemon.communicate(timeout=PATIENCE_S)
    assert bench.daemon.returncode == 1
    assert f"thread '{thread}' died" in said and "Traceback" in said and "no_such_thing" in said.replace(" ", "_")
    manifest = read_run(path).manifest
    assert manifest.exit_status == "failed"
    assert thread in manifest.reason and error in manifest.reason
    assert bench.run("rig", "verify", path).returncode == 0
    assert "no daemon" in bench.fails("rig", "status", code=4)
