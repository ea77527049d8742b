import grp
import json
import math
import os
import socket
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml

import daq.feedback
from daq.acquisition.streams import Stream, robot_stream, streams_of
from daq.discovery import examine_computer as computer
from daq.discovery import trial
from daq.discovery.cell_finding import CellFinding, FindingVerdict, check_condition
from daq.discovery.examine import check_daemon, examine
from daq.emulators.instruments import emulated
from daq.emulators.network_ports import TcpPort
from daq.protocol.conversation import NO_TIME, Fault, FaultKind, Sample
from daq.service.client import Client
from rigs.load import SHIPPED, parse
from rigs.schema.condition import UNDISTURBED, ProgramState, SafetyState
from tests.support.bench import ByHand, rig_text
from tests.support.drivers import rtde

FTDI = "/dev/serial/by-id/usb-FTDI_FT232R_A900XYZ-if00-port0"
OK, DOUBTFUL, WRONG = FindingVerdict.OK, FindingVerdict.DOUBTFUL, FindingVerdict.WRONG


@pytest.fixture
def system(tmp_path):
    (tmp_path / "dev/serial/by-id").mkdir(parents=True)
    (tmp_path / "dev/ttyUSB0").touch()
    (tmp_path / FTDI[1:]).symlink_to("../../ttyUSB0")
    (tmp_path / "sys/bus/usb-serial/devices/ttyUSB0").mkdir(parents=True)
    (tmp_path / "sys/bus/usb-serial/devices/ttyUSB0/latency_timer").write_text("16\n")
    (tmp_path / "proc/77/fd").mkdir(parents=True)
    (tmp_path / "proc/77/comm").write_text("ModemManager\n")
    (tmp_path / "proc/77/fd/5").symlink_to("/dev/null")
    return tmp_path


def test_a_port_that_is_not_there(system):
    (finding,) = computer.examine_port("g1", "/dev/ttyUSB1", system, served=False)
    assert finding.verdict is WRONG and finding.remedy.endswith(f"available ports: {FTDI}")
    (system / FTDI[1:]).unlink()
    (system / "dev/ttyUSB0").unlink()
    assert computer.check_exists("g1", FTDI, system).remedy.endswith("available ports: none")


def test_a_name_that_changes_with_the_order_of_plugging_in(system):
    assert computer.check_name("g1", FTDI, system) is None
    finding = computer.check_name("g1", "/dev/ttyUSB0", system)
    assert finding.verdict is DOUBTFUL and finding.remedy == f"write port: {FTDI}"
    (system / "dev/rig").mkdir()
    (system / "dev/rig/A900XYZ-00").symlink_to("../ttyUSB0")
    finding = computer.check_name("g1", "/dev/ttyUSB0", system)
    assert finding.remedy == "write port: /dev/rig/A900XYZ-00"


def test_a_port_that_another_program_holds(system):
    assert computer.check_use("g1", FTDI, system) is None
    (system / "proc/77/fd/6").symlink_to("/dev/ttyUSB0")
    finding = computer.check_use("g1", FTDI, system)
    assert finding.verdict is WRONG and "ModemManager (process 77)" in finding.what
    assert finding.remedy.endswith("sudo systemctl disable --now ModemManager")
    (system / "proc/77/comm").write_text("picocom\n")
    finding = computer.check_use("g1", FTDI, system)
    assert finding.remedy == "end it: sudo kill 77"
    assert WRONG not in {f.verdict for f in computer.examine_port("g1", FTDI, system, served=True)}  # rigd may hold it


def test_the_permissions_of_a_port(system, monkeypatch):
    monkeypatch.setattr(os, "access", lambda *_: False)  # root may everything
    finding = computer.check_access("g1", FTDI, system)
    assert finding.verdict is WRONG and "usermod -aG" in finding.remedy
    monkeypatch.setattr(os, "access", lambda *_: True)
    group = grp.getgrgid((system / "dev/ttyUSB0").stat().st_gid).gr_name
    finding = computer.check_access("g1", FTDI, system)
    if group != "dialout":
        assert finding.verdict is DOUBTFUL and f"group {group} " in finding.what


@pytest.mark.parametrize(("ms", "verdict"), [("16", DOUBTFUL), ("2", DOUBTFUL), ("1", OK), ("?", None)])
def test_the_latency_timer(system, ms, verdict):
    (system / "sys/bus/usb-serial/devices/ttyUSB0/latency_timer").write_text(f"{ms}\n")
    finding = computer.check_latency("g1", FTDI, system)
    assert (finding and finding.verdict) == verdict


@pytest.mark.parametrize(
    ("finding", "verdict"),
    [
        (computer.check_free_space(Path("runs"), 80.0), OK),
        (computer.check_free_space(Path("runs"), 3.0), DOUBTFUL),
        (computer.check_free_space(Path("runs"), 0.2), WRONG),
        (computer.check_sync_time(Path("runs"), 0.004), OK),
        (computer.check_sync_time(Path("runs"), 0.3), DOUBTFUL),
        (computer.check_sync_time(Path("runs"), 7.0), WRONG),
        (computer.check_wall_clock(0), OK),
        (computer.check_wall_clock(5), DOUBTFUL),
    ],
)
def test_figures_of_the_computer_are_judged(finding, verdict):
    assert finding.verdict is verdict and bool(finding.remedy) == (verdict is not OK)


@pytest.mark.parametrize(
    ("shown", "verdict", "says"),
    [
        ("LoadState=not-found ActiveState=inactive SubState=dead", DOUBTFUL, "not installed"),
        ("LoadState=loaded ActiveState=inactive SubState=dead", DOUBTFUL, "stopped"),
        ("LoadState=loaded ActiveState=failed SubState=failed Result=exit-code", WRONG, "failed (exit-code)"),
        ("LoadState=loaded ActiveState=activating SubState=auto-restart NRestarts=7", WRONG, "after 7 attempts"),
        ("LoadState=loaded ActiveState=active SubState=running NRestarts=0 UnitFileState=enabled", OK, "running"),
        ("LoadState=loaded ActiveState=active SubState=running NRestarts=2 UnitFileState=enabled", DOUBTFUL, "2 times"),
        (
            "LoadState=loaded ActiveState=active SubState=running UnitFileState=disabled",
            DOUBTFUL,
            "at boot",
        ),
    ],
)
def test_states_of_the_service_are_judged(shown, verdict, says):
    finding = computer.check_service("rigd@cell", dict(part.split("=") for part in shown.split()))
    assert finding.verdict is verdict and says in finding.what


def _samples(rate_hz: float, seconds: float, drift_ppm: float) -> list[Sample]:
    """Samples of a controller with a fast clock that arrive up to 2 ms late."""
    made = []
    for number in range(round(rate_hz * seconds)):
        sent_ns = round(number * 1e9 / rate_hz)
        at_ns = sent_ns + 2_000_000 * (number * 7 % 10) // 9
        made.append(Sample((0.0,) * 6, NO_TIME, at_ns, at_ns, 60, 100 + sent_ns * 1e-9 * (1 + drift_ppm * 1e-6)))
    return made


@pytest.mark.parametrize(("drift_ppm", "verdict"), [(30, OK), (-400, OK), (5000, DOUBTFUL), (-1e6 / 2, DOUBTFUL)])
def test_the_clock_of_a_controller(drift_ppm, verdict):
    finding = trial.check_clock("robot", _samples(500, 3, drift_ppm))
    assert finding.verdict is verdict
    assert abs(int(finding.what.split()[3]) - drift_ppm) < max(100, abs(drift_ppm) * 0.01), finding.what
    assert trial.check_clock("g1", [replace(s, device_time_s=math.nan) for s in _samples(500, 3, 0)]) is None


def test_gauge_far_below_the_rate_of_its_line():
    stream = streams_of(parse(rig_text(), "bench"))[0]
    samples = _samples(20, 2, 0)
    finding = trial.check_rate(stream, trial.Trial(samples, 2.0, 360, 360))
    assert finding.verdict is DOUBTFUL and "20.0 readings a second" in finding.what
    finding = trial.check_rate(stream, trial.Trial(samples, 2.0, 6000, 6000))
    assert finding.verdict is OK


def test_signed_readings_that_are_read_as_unsigned_are_wrong():
    stream = streams_of(parse(rig_text(), "bench"))[0]
    values = [0.012, 65.517, 0.004, 65.531, 0.007]
    columns = len(stream.columns)
    samples = [replace(s, values=(v,) * columns) for s, v in zip(_samples(20, 2, 0), values, strict=False)]
    found = list(trial.check_signs(stream, trial.Trial(samples, 2.0, 360, 360)))
    assert [one.verdict for one in found] == [FindingVerdict.WRONG] * columns
    assert "`type: int16`" in found[0].remedy
    sound = [replace(s, values=(0.01,) * columns) for s in samples]
    assert not list(trial.check_signs(stream, trial.Trial(sound, 2.0, 360, 360)))


@contextmanager
def _switched_on(text: str) -> Iterator[dict[str, Any]]:
    cell = emulated(parse(text, "bench"), ByHand())
    cell.start()
    try:
        yield yaml.safe_load(cell.rig_text(text))
    finally:
        cell.stop()


def _streams(data: object) -> dict[str, Stream]:
    return {stream.name: stream for stream in streams_of(parse(yaml.safe_dump(data), "bench"))}


def test_line_settings_that_would_work_are_found(monkeypatch):
    """A Sylvac cable at the maker's 4800 and a Modbus gauge at 9600 baud; the rig file has both otherwise."""
    data = yaml.safe_load(rig_text("polled"))
    data["gauges"]["g1"]["line"] = "4800 7E2"
    data["gauges"]["g2"] = {**yaml.safe_load(rig_text("modbus"))["gauges"]["g2"], "line": "9600 8E1"}
    monkeypatch.setattr(trial, "_TALK_S", 4.0)  # for a busy computer
    with _switched_on(yaml.safe_dump(data)) as served:
        good, *_ = trial.examine_conversation(_streams(served)["g1"], 0.3)  # the rate is that of this computer
        served["gauges"]["g1"]["line"], served["gauges"]["g2"]["line"] = "9600 8N1", "38400 8N1"
        streams = _streams(served)
        (first,) = trial.examine_conversation(streams["g1"], 0.3)
        (second,) = trial.examine_conversation(streams["g2"], 0.3)
    assert good.verdict in (OK, DOUBTFUL) and "at 4800 7E2 with DTR on, RTS off: " in good.what
    assert first.verdict is second.verdict is WRONG
    assert "at 4800 7E2" in first.what and first.remedy == "write line: 4800 7E2"
    assert "at 9600 8" in second.what  # a pty knows no parity


def test_nothing_and_something_else_behind_the_robot_s_port():
    with socket.create_server(("127.0.0.1", 0)) as other:
        data = yaml.safe_load(rig_text("tcp"))
        data["feedback"]["port"] = f"tcp://127.0.0.1:{other.getsockname()[1]}"
        robot = _streams(data)["robot"]

        def greet() -> None:
            connection, _ = other.accept()
            with connection:
                connection.sendall(b"220 welcome to the print server\r\n")
                connection.recv(1000)

        threading.Thread(target=greet, daemon=True).start()
        (finding,) = trial.examine_conversation(robot, 0.3)
    assert finding.verdict is WRONG and "33 bytes " in finding.what, finding
    (finding,) = trial.examine_conversation(robot, 0.3)
    assert finding.verdict is WRONG and "connection refused" in finding.what


def test_a_cell_that_is_not_there_at_all(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    with socket.create_server(("127.0.0.1", 0)) as gone:
        data = yaml.safe_load(rig_text())
        data["feedback"]["port"] = f"tcp://127.0.0.1:{gone.getsockname()[1]}"
    findings = list(examine(parse(yaml.safe_dump(data), "bench"), tmp_path / "runs"))
    assert [finding.about for finding in findings][:3] == ["disk", "disk", "clock"]
    assert [finding.about for finding in findings[3:]] == ["g1", "g2", "robot"], findings
    assert {finding.verdict for finding in findings[3:]} == {WRONG}
    assert not list(tmp_path.iterdir())


def test_a_disk_that_this_user_may_not_use(tmp_path, monkeypatch):
    def refused(_: Path) -> float:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(computer, "slowest_sync_s", refused)
    findings = list(computer.examine_computer(tmp_path / "runs", None))
    assert [finding.verdict for finding in findings[:2]] == [OK, DOUBTFUL] and "permission" in findings[1].what


GOOD = {
    "port": "/dev/g1",
    "connected": True,
    "rate_hz": 48.0,
    "last": {"g1_mm": 1.0},
    "age_s": {"g1_mm": 0.02},
    "counters": {"samples": 900},
    "last_fault": "",
}


@pytest.mark.parametrize(
    ("stream", "verdict", "says"),
    [
        ({}, OK, "48.0 readings a second, 900 so far"),
        ({"counters": {"samples": 900, "silent": 3}}, OK, "48.0"),
        ({"counters": {"samples": 900, "silent": 30}, "last_fault": "0.5 s"}, DOUBTFUL, "30 silent"),
        ({"age_s": {"g1_mm": 4.0}}, WRONG, "g1_mm are"),
        ({"age_s": {}}, WRONG, "g1 are"),
        ({"connected": False, "last_fault": "absent"}, WRONG, "not open"),
    ],
)
def test_states_of_a_stream_are_judged(stream, verdict, says):
    status = {"rig": "bench", "recording": None, "streams": {"g1": GOOD | stream}}
    served = replace(streams_of(parse(rig_text("keyence"), "bench"))[-1], name="g1", port="/dev/g1")
    rigd, finding = check_daemon(status, [served])
    assert [f.verdict for f in check_daemon(status, [replace(served, port="/dev/g2")])][:2] == [OK, WRONG]
    assert rigd.verdict is OK and (finding.about, finding.verdict) == ("g1", verdict) and says in finding.what
    assert bool(finding.remedy) == (verdict is not OK)
    del status["streams"]["g1"]["port"]
    older = list(check_daemon(status, [served]))
    assert older[1].verdict is DOUBTFUL and older[2].what == finding.what


def test_a_daemon_is_asked_in_place_of_the_ports(bench):
    bench.start().all_reading()
    done = bench.run("rig", "doctor", bench.rig, "--json")
    said = json.loads(done.stdout)
    assert done.returncode == 0 and said["rig"] == "bench" and said["wrong"] == 0, said
    assert any(f["about"] == "rigd" for f in said["findings"])
    with Client(bench.socket) as client:
        # A computer that is held up stalls readers and has answers come late; a port that is opened is another fault.
        usual = {"samples", "stalled", "silent", "late"}
        faults = {name: s["counters"].keys() - usual for name, s in client.ask("status")["streams"].items()}
    assert not any(faults.values())  # the doctor has touched nothing
    bench.cell.stop()
    bench.until(lambda state: not state["streams"]["robot"]["connected"])
    done = bench.run("rig", "doctor", bench.rig)
    assert done.returncode == 1 and "wrong     robot: " in done.stdout, done.stdout


def test_a_few_readings_among_hundreds_of_garbled_messages_are_an_accident():
    readings = [Sample((1.0,), k, k, k, 9) for k in range(9)]
    first = Fault(FaultKind.GARBLED, 5, "wrong parity")
    assert trial.Trial([*readings, first]).understood
    assert not trial.Trial([*readings, first, replace(first, count=500)]).understood  # counted once a second


@pytest.mark.parametrize("closes", [False, True], ids=["stays", "closes"])
def test_faults_that_a_conversation_still_holds_back_count_at_its_end(closes):
    over = threading.Event()
    with socket.create_server(("127.0.0.1", 0)) as server:

        def peer() -> None:
            with server.accept()[0] as link:
                link.sendall(b"".join(b"%d,0,0,0,0,0,0\n" % k for k in range(30)) + b"no,number\n" * 600)
                if not closes:
                    over.wait(20)

        sender = threading.Thread(target=peer)
        sender.start()
        data = yaml.safe_load((SHIPPED / "paper-fanuc.yaml").read_text())
        data["feedback"]["port"] = f"tcp://127.0.0.1:{server.getsockname()[1]}"
        robot = _streams(data)["robot"]

        found = trial.try_line(robot, robot.line, 0.5, 0.1)
        over.set()
        sender.join()
    assert sum(one.count for one in found.items if isinstance(one, Fault) and one.kind is FaultKind.GARBLED) == 600
    assert not found.understood and ("lost" in found.last_fault) is closes


def _read(*values: float) -> list[Sample]:
    return [Sample(values, k, k, k, 9) for k in range(10)]


def _with_pause(pause_s: float, kind: FaultKind) -> list[Sample | Fault]:
    """Eighty readings with a fault after the fortieth."""
    stamps_ns = [int(1e9 * (1 + k / 40 + pause_s * (k >= 40))) for k in range(80)]
    readings = [Sample((1.0,), at_ns - 10, at_ns - 1, at_ns, 9) for at_ns in stamps_ns]
    return [*readings[:40], Fault(kind, stamps_ns[40] - 1, "longer timeout_s"), *readings[40:]]


@pytest.mark.parametrize(
    ("columns", "items", "verdict", "says", "remedy"),
    [
        (
            1,
            [*_read(1.0), *[Fault(FaultKind.DEVICE_ERROR, 5, "exception 6")] * 10],
            DOUBTFUL,
            "10 device_error",
            "exception 6",
        ),
        (
            2,
            [*_read(1.0, math.nan), Fault(FaultKind.SILENT, 5, "unit 2: silent")],
            WRONG,
            "without g2_mm",
            "unit 2: silent",
        ),
        (1, [Fault(FaultKind.SILENT, 5, "silent for 0.1 s")], WRONG, "accepts", ""),
        (1, _with_pause(1.2, FaultKind.SILENT), DOUBTFUL, "1.2 s of them without an answer (1 silent)", "longer"),
        (1, _with_pause(0.3, FaultKind.LATE), DOUBTFUL, "0.3 s of them without an answer (1 late)", "longer"),
        (1, _with_pause(0.05, FaultKind.SILENT), OK, "80 readings in 2 s", ""),
        (1, _with_pause(1.2, FaultKind.SILENT)[40:], OK, "40 readings in 2 s", ""),
        (1, [Fault(FaultKind.DISCONNECTED, 6, "lost")], WRONG, "nothing arrived", "lost"),
        (1, [], WRONG, "accepts", ""),
    ],
    ids=[
        "exceptions",
        "one of two gauges",
        "silent host",
        "unanswered",
        "late",
        "one short pause",
        "silent before the first reading",
        "gone",
        "nothing",
    ],
)
def test_answers_of_a_trial_are_judged(columns, items, verdict, says, remedy):
    stream = replace(_streams(yaml.safe_load(rig_text("tcp")))["g1"], columns=("g1_mm", "g2_mm")[:columns])
    found = trial.Trial(items, 2.0, *((90, 170) if len(items) > 1 else ()))
    finding = trial.check_answers(stream, found, lambda: None)
    assert finding.verdict is verdict and says in finding.what and finding.remedy.startswith(remedy)


@contextmanager
def _robot(condition: Sequence[float]) -> Iterator[Stream]:
    robot, stop = rtde(rate_hz=125), threading.Event()
    port = TcpPort(lambda: daq.feedback.device(robot, lambda now_ns: [1.0] * 6 + [*condition]))
    thread = threading.Thread(target=port.serve, args=(stop,))
    thread.start()
    try:
        yield replace(robot_stream(robot), port=port.port)
    finally:
        stop.set()
        thread.join()


def _beyond_answers(found: Sequence[CellFinding]) -> list[tuple[FindingVerdict, str]]:
    return [(finding.verdict, f"{finding.what}: {finding.remedy}") for finding in found if finding.remedy]


def test_robot_in_protective_stop_is_reported_with_program_and_speed():
    with _robot([ProgramState.PAUSED, SafetyState.PROTECTIVE_STOP, 40.0]) as stream:
        found = _beyond_answers(list(trial.examine_conversation(stream, 0.3)))
    assert [verdict for verdict, _ in found] == [
        FindingVerdict.WRONG,
        FindingVerdict.DOUBTFUL,
        FindingVerdict.DOUBTFUL,
    ], found
    assert "protective stop" in found[0][1] and "unlock" in found[0][1]
    assert "paused" in found[1][1] and "40 %" in found[2][1]


def test_missing_condition_fields_are_named_and_not_judged():
    readings = trial.Trial([Sample((*[1.0] * 6, math.nan, 0.0, *[math.nan] * 8), k, k, k, 9) for k in range(9)])
    finding = trial.check_answers(robot_stream(rtde()), readings, lambda: None)
    assert (
        finding.verdict is FindingVerdict.OK
        and "not available: program_state, speed_percent, payload_kg" in finding.what
    )


@pytest.mark.parametrize(
    ("shown", "count"),
    [
        ({}, 0),
        (UNDISTURBED, 0),
        (dict.fromkeys(UNDISTURBED, math.nan), 0),
        ({"program_state": 0.0, "speed_percent": 0.0, "safety_state": 1.0}, 0),
        ({"motors_on": 0.0}, 1),
        ({"speed_percent": 99.0}, 1),
        ({"safety_state": 6.0, "motors_on": 0.0}, 2),
    ],
)
def test_each_condition_by_itself(shown, count):
    assert len(list(check_condition("robot", shown))) == count


@pytest.mark.parametrize(
    ("connected", "age_s", "is_shown"), [(True, 0.1, True), (True, 60.0, False), (False, 0.1, False)]
)
def test_daemon_shows_the_present_condition(connected, age_s, is_shown):
    stream, last = robot_stream(rtde()), {"q1_deg": 1.0, "safety_state": 4.0, "temperature1_c": 30.0}
    robot = {
        "port": stream.port,
        "connected": connected,
        "rate_hz": 500.0,
        "counters": {"samples": 9},
        "last_fault": "",
    }
    robot |= {"last": last, "age_s": {"q1_deg": 0.1, "safety_state": age_s, "temperature1_c": 100.0}}
    found = check_daemon({"rig": "bench", "recording": None, "streams": {"robot": robot}}, [stream])
    assert any("emergency stop" in finding.what for finding in found) == is_shown
