import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest
from pydantic import TypeAdapter

import daq.feedback
from daq.discovery.cell_finding import STOPS
from daq.discovery.robots import joints_of, layout_of, search_robot
from daq.emulators.network_ports import TcpPort
from daq.protocol.conversation import Arrival, ConversationStep, Device
from rigs.schema.condition import ProgramState, SafetyState
from rigs.schema.feedback import Feedback, OPCUARobotics
from tests.support.drivers import OPC_UA, opc_ua, rtde
from tests.support.refusals import refused
from tests.support.unknown_cells import ROBOTS, switched_on

DEGREES = [0.5, -70.0, 100.0, 55.25, 84.5, 107.75]


@pytest.mark.parametrize("kind", ROBOTS)
def test_the_robot_of_a_cell_is_found(kind):
    with switched_on("tesa", kind) as unknown:
        unknown.hand.deg = DEGREES
        fields = {**ROBOTS[kind], "port": unknown.robot}
        named = TypeAdapter(Feedback).validate_python(fields) if unknown.robot_is_named else None
        report = search_robot(unknown.robot, named)
        assert report.feedback is not None, report
        assert joints_of(report.feedback) == pytest.approx(DEGREES, abs=1e-4)
    assert report.feedback.interface == ROBOTS[kind]["interface"]
    assert report.joints_deg == pytest.approx(DEGREES, abs=1e-4)
    assert report.units_sure and not report.problem
    if kind == "kuka":
        # its IPOC shows the cycle
        assert report.feedback.cycle_ms == 12
    if kind == "fanuc":
        assert report.feedback.fields[0] == "t_ms"


@contextmanager
def opc_ua_served(feedback: OPCUARobotics) -> Iterator[None]:
    """A server in a protective stop at port 4840 of 127.0.0.48."""
    shown = [*DEGREES, 0.0, float(SafetyState.PROTECTIVE_STOP), 1.0, 100.0, 0.0, *[30.0] * 6]
    listener = socket.create_server(("127.0.0.48", 4840))
    server = TcpPort(lambda: daq.feedback.device(feedback, lambda _: shown), server=listener)
    stop = threading.Event()
    thread = threading.Thread(target=server.serve, args=(stop,))
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()


@pytest.mark.skipif(not OPC_UA, reason="no asyncua")
def test_port_4840_is_asked_as_opc_ua():
    feedback = opc_ua(port="tcp://127.0.0.48:4840")
    absent = search_robot(feedback.port)
    assert "opc_ua_robotics" in absent.problem and "anonymous" in absent.remedy
    with opc_ua_served(feedback):
        report = search_robot(feedback.port)
    assert report.feedback == feedback and report.joints_deg == pytest.approx(DEGREES)
    assert "protective stop" in report.reported


@pytest.mark.skipif(not OPC_UA, reason="no asyncua")
def test_incomplete_opc_ua_server_names_the_missing_axes():
    names = ("Base", "Shoulder", "Elbow", "Wrist1", "Wrist2", "Wrist3")
    feedback = opc_ua(port="tcp://127.0.0.48:4840", axes=names)
    with opc_ua_served(feedback):
        report = search_robot(feedback.port)
    assert report.feedback is None and "`axes`" in report.problem and "Wrist1" in report.problem


class _Listener:
    sent = 0

    def __init__(self) -> None:
        self.heard = b""

    def connected(self, now_ns: int) -> ConversationStep:
        return ConversationStep()

    def tick(self, now_ns: int) -> ConversationStep:
        return ConversationStep()

    def received(self, data: bytes, now_ns: int) -> ConversationStep:
        self.heard += data
        return ConversationStep()


def test_a_port_that_is_not_rtdes_is_sent_nothing():
    listener = _Listener()
    with served(lambda: listener) as port:
        report = search_robot(port)
    assert listener.heard == b"" and "no data" in report.problem
    assert "--key feedback.interface=ur_rtde" in report.remedy


def test_accepting_silent_host_is_not_reported_off():
    with served(_Listener) as port:
        report = search_robot(port, rtde(port=port))
    assert "ur_rtde" in report.problem and "no data" in report.problem
    assert "settings" in report.remedy and "switch" not in report.remedy


def test_a_udp_port_that_is_not_stream_motions_is_sent_nothing():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        search_robot(f"udp://127.0.0.1:{other.getsockname()[1]}")
        other.setblocking(False)
        with pytest.raises(BlockingIOError):
            other.recv(100)


def test_a_robot_that_is_not_there():
    with socket.create_server(("127.0.0.1", 0)) as gone:
        port = gone.getsockname()[1]
    report = search_robot(f"tcp://127.0.0.1:{port}")
    assert report.feedback is None and "connection refused" in report.problem and report.remedy


@pytest.mark.parametrize("address", ["a b", "", "tcp://host", "tcp://host:99999", "udp://x", "::1", "a/b"])
def test_invalid_address_is_named(address):
    report = search_robot(address)
    assert "address" in report.problem and "HOST" in report.remedy


def test_a_controller_that_does_not_call():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    report = search_robot(f"udp://127.0.0.1:{port}")
    assert report.feedback is None and "nothing arrived" in report.problem and "RSI_ON" in report.remedy


def test_joints_of_a_robot_that_has_gone():
    with switched_on("tesa", "fanuc") as unknown:
        report = search_robot(unknown.robot)
    with refused("port.refused"):
        joints_of(report.feedback)


@contextmanager
def served(device: Callable[[], Device]) -> Iterator[str]:
    port, stop = TcpPort(device), threading.Event()
    thread = threading.Thread(target=port.serve, args=(stop,))
    thread.start()
    try:
        yield port.port
    finally:
        stop.set()
        thread.join()


@pytest.mark.parametrize("safety", SafetyState)
def test_a_robot_that_runs_no_program_is_found_with_the_reason(safety):
    robot = rtde(rate_hz=125)
    with served(lambda: daq.feedback.device(robot, lambda _: [*DEGREES, ProgramState.STOPPED, safety])) as port:
        report = search_robot(port, robot.model_copy(update={"port": port}))
    assert report.joints_deg == pytest.approx(DEGREES) and report.reported == "; ".join(STOPS.get(safety, ()))
    if safety is SafetyState.PROTECTIVE_STOP:
        assert "protective stop" in report.reported and "unlock" in report.reported


JOINTS = tuple(f"q{axis}_deg" for axis in range(1, 7))
ANGLES = (1.5, -70.25, 100.0, 55.0, 85.0, 108.0)


def printed(line: Callable[[int], str], count: int = 30) -> list[Arrival]:
    return [(line(k).encode(), 1_000_000_000 + 10_000_000 * k) for k in range(count)]


def joined(values: tuple[float, ...], separator: str = ",") -> str:
    return separator.join(f"{value:.5f}" for value in values)


@pytest.mark.parametrize(
    ("line", "fields", "separator"),
    [
        (lambda k: f"{10 * k},{joined(ANGLES)}\r\n", ("t_ms", *JOINTS), ","),
        (lambda k: f"{joined(ANGLES)},{0.01 * k:.3f}\n", (*JOINTS, "t_s"), ","),
        (lambda k: f"{10_000 * k};{joined(ANGLES, ';')}\n", ("t_us", *JOINTS), ";"),
        (lambda k: f"  {joined(ANGLES, '   ')}  \n", JOINTS, " "),
        (lambda k: f"J,{joined(ANGLES)},0\n", ("_", *JOINTS, "_"), ","),
    ],
)
def test_layouts(line, fields, separator):
    layout = layout_of(printed(line))
    assert (layout.fields, layout.separator, layout.sure) == (fields, separator, True)


def test_a_joint_that_turns_is_not_taken_for_a_clock():
    layout = layout_of(printed(lambda k: f"{10 * k},{0.2 * k},{joined(ANGLES[1:])}\n"))
    assert layout.fields == ("t_ms", *JOINTS)


def test_small_angles_could_be_radians():
    layout = layout_of(printed(lambda k: f"{joined((0.1, -1.2, 1.7, 0.9, 1.5, 1.9))}\n"))
    assert not layout.sure


@pytest.mark.parametrize(
    "line",
    [
        lambda k: "220 printer ready\r\n",
        lambda k: "1,2,3,4,5\n",
        lambda k: ",".join("1" * (6 + k % 2)) + "\n",
        lambda k: "\x00\xff\x01 no lines",
        lambda k: "nan,nan,nan,nan,nan,nan\n",
    ],
)
def test_other_lines_are_no_joints(line):
    assert layout_of(printed(line)) is None


def test_nothing_and_little():
    assert layout_of([]) is None
    assert layout_of(printed(lambda k: f"{joined(ANGLES)}\n", count=3)) is None
