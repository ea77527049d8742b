"""Faults of a cell. Each is reported in one line with its remedy and an exit code, and loses no recorded data."""

import contextlib
import errno
import os
import resource
import signal
import socket
import subprocess
from pathlib import Path

import numpy as np
import pytest
import yaml

from daq.service.client import Client
from daq.store import read_run
from rigs.errors import RigError
from tests.support.bench import BIN, OFF, Bench, rig_text
from tests.support.child_processes import until
from tests.support.refusals import refused


@pytest.fixture(scope="module")
def running(tmp_path_factory):
    """Run a cell whose daemon only answers requests; slow, because it runs next to all other tests."""
    data = yaml.safe_load(rig_text())
    data["feedback"]["rate_hz"] = 20
    with Bench(tmp_path_factory.mktemp("running"), yaml.safe_dump(data)) as bench:
        bench.start().all_reading()
        yield bench


def _edited(bench: Bench, **gauges: str) -> None:
    data = yaml.safe_load(bench.rig.read_text())
    for name, port in gauges.items():
        (data["feedback"] if name == "feedback" else data["gauges"][name])["port"] = port
    bench.rig.write_text(yaml.safe_dump(data))


def test_zeros_of_a_view_are_noted_and_change_no_rows(bench):
    bench.start().all_reading()
    with Client(bench.socket) as client:
        label = {"name": "lap", "test": "yaw", "direction": "cw"}
        with refused("request.invalid"):
            client.ask("record_start", **label, view_zero_mm=[1e9, "x"])
        run = Path(client.ask("record_start", **label, view_zero_mm=[0.1, -0.1])["run"])
        client.ask("record_stop")
    read = read_run(bench.folder / run)
    assert read.manifest.view_zero_mm == (0.1, -0.1)
    assert set(np.asarray(read.streams["g1"]["g1_mm"])) == {0.1}


def test_every_closed_link_is_reported(bench):
    with socket.create_server(("127.0.0.1", 0)) as server:
        free = server.getsockname()[1]
    _edited(bench, g1="/dev/ttyNOPE", feedback=f"tcp://127.0.0.1:{free}")
    done = bench.run("rigd", bench.rig)
    assert done.returncode == 4
    assert [line.split(",")[0] for line in done.stderr.splitlines()] == ["error: g1", "error: robot"]
    assert "connection refused" in done.stderr


def test_gauge_in_error_is_counted_and_prevents_recording(bench):
    bench.start().all_reading()
    bench.motion.mm["g1"] = OFF
    bench.until(lambda state: state["streams"]["g1"]["age_s"]["g1_mm"] > 3)
    told = bench.fails("rig", "record", "start", "x", "--test", "yaw", "--direction", "cw", code=4)
    assert told.startswith("error: g1: no reading") and "ERR0: sensor error" in told
    assert bench.status()["streams"]["g1"]["counters"]["device_error"] > 0


def test_a_second_daemon_on_the_same_rig_is_refused(running):
    told = running.fails("rigd", running.rig, code=4)
    assert "a different rigd" in told and str(running.daemon.pid if running.daemon else "") in told
    running.all_reading()


def test_a_full_disk_ends_the_recording_and_not_the_daemon(bench):
    limit = 200_000
    bench.start(preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)))
    bench.all_reading()
    path = bench.record()
    state = bench.until(lambda state: state["recording"] is None)
    assert "rig recover" in state["last_end"]
    with Client(bench.socket) as client, pytest.raises(RigError) as told:  # soon, before another run follows
        client.ask("record_stop")
    assert told.value.code == "recording.none" and os.strerror(errno.EFBIG) in told.value.what
    assert "was abandoned" in told.value.what
    bench.all_reading()
    # The writer lets go of its files after the state says that the recording has ended.
    assert until(lambda: bench.run("rig", "recover", path).returncode == 0)
    assert bench.run("rig", "verify", path).returncode == 0
    assert len(read_run(path).streams["robot"]["q1_deg"]) > 500
    bench.record("again")


def test_ctrl_c_while_recording_closes_the_run(bench):
    bench.start().all_reading()
    path = bench.record()
    bench.recorded(50)
    code, said = bench.signalled(signal.SIGINT)
    assert code == 130
    assert f"are safe: {path}" in said and "Traceback" not in said
    run = read_run(path)
    assert run.manifest.exit_status == "interrupted" and "SIGINT" in run.manifest.reason
    assert bench.run("rig", "verify", path).returncode == 0
    assert not bench.socket.exists()


@pytest.mark.parametrize(
    ("command", "code", "told"),
    [
        (("record", "stop"), 4, "no recording"),
        (("status", "--rig", "other"), 4, "no daemon"),
    ],
)
def test_impossible_requests_are_refused(running, command, code, told):
    assert told in running.fails("rig", *command, code=code)


def test_output_onto_a_full_disk_is_one_line():
    with Path("/dev/full").open("w") as full:
        done = subprocess.run([BIN / "rig", "interfaces"], stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 4 and len(done.stderr.splitlines()) == 1 and os.strerror(errno.ENOSPC) in done.stderr


def test_stale_socket_hides_no_other_daemon(bench):
    bench.socket.parent.mkdir()
    with socket.socket(socket.AF_UNIX) as left:
        left.bind(str(bench.socket.with_name("other.sock")))
    assert "no daemon" in bench.fails("rig", "status", code=4)
    bench.start().all_reading()
    assert bench.run("rig", "status", "--json").returncode == 0
    bench.signalled(signal.SIGKILL)
    assert bench.socket.exists()
    assert "no daemon" in bench.fails("rig", "status", "--rig", "bench", code=4)


def test_a_socket_that_cannot_be_leaves_no_empty_capture(bench):
    long = bench.folder / f"{'x' * 120}.sock"
    assert str(long) in bench.fails("rigd", bench.rig, "--socket", long, "--capture", "cell.rigcap", code=4)
    assert not (bench.folder / "cell.rigcap").exists()


def test_only_owner_and_group_may_use_the_socket(running):
    assert running.socket.stat().st_mode & 0o777 == 0o660
    assert running.socket.parent.stat().st_mode & 0o777 == 0o700


def _sockets_of(pid: int) -> set[str]:
    """Inodes of the sockets that a process holds; its files come and go while they are listed."""
    inodes = set()
    for entry in Path(f"/proc/{pid}/fd").iterdir():
        with contextlib.suppress(FileNotFoundError):
            target = os.readlink(entry)  # noqa: PTH115 - no path, a socket's name
            if target.startswith("socket:["):
                inodes.add(target[8:-1])
    return inodes


def test_nothing_listens_on_the_network(running):
    inodes = _sockets_of(running.daemon.pid)
    assert inodes  # its control socket at least
    listening = "0A"
    for table in ("tcp", "tcp6", "udp", "udp6"):
        for row in Path(f"/proc/{running.daemon.pid}/net/{table}").read_text().splitlines()[1:]:
            cells = row.split()
            assert not ((table.startswith("udp") or cells[3] == listening) and cells[9] in inodes)
