"""Every interface that an independent implementation can be had for, held against it, our side and the emulator's.

A peer shares no code with ours: the other end of the wire is theirs. Programs of Python are in the environment of this
program (tests/trials/wire_peers.lock), node-opcua wherever node finds it (NODE_PATH); what is not
installed is skipped, with the reason. `PEERS` is the one declaration:
docs/interfaces.md lists them. Exit code 1 if a peer disagrees.
"""

from __future__ import annotations

import math
import socket
import subprocess
import sys
import threading
import time
from argparse import Namespace
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from shutil import which
from typing import Any

from tests.support.trial import Trial, main

ROOT = Path(__file__).parents[2]
ANGLES_DEG = [10.0, -20.5, 30.25, -40.125, 50.0625, 359.0]
GAUGE_MM = 1.234375
"""A number that a float32 holds exactly."""
PATIENCE_S = 20.0
ENOUGH = 200
_NO_TESTS = 5
"""Exit code of pytest if a complete file is skipped."""
OPC_UA_TESTS = "tests/daq/opc_ua/test_opc_ua.py"


class Disagrees(Exception):
    """Error: the peer received data other than those sent."""


class Absent(Exception):
    """The peer is not installed here."""


@dataclass(frozen=True)
class Peer:
    """An independent implementation. what: rig's side of the connection; check: returns the verified data, or
    raises.
    """

    name: str
    interfaces: tuple[str, ...]
    what: str
    check: Callable[[], str]


def _tested(file: str) -> Callable[[], str]:
    def check() -> str:
        command = [sys.executable, "-m", "pytest", "-q", "-rs", "-p", "no:cacheprovider", file]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
        last = done.stdout.strip().splitlines()[-1] if done.stdout.strip() else done.stderr[-200:]
        if done.returncode not in (0, _NO_TESTS):
            raise Disagrees(last)
        if "passed" not in last:
            raise Absent(next((line for line in done.stdout.splitlines() if line.startswith("SKIPPED")), last))
        return f"{file}: {last}"

    return check


def _hold(what: str, got: Any, sent: Any, within: float) -> None:
    if len(got) != len(sent) or any(not abs(a - b) <= within for a, b in zip(got, sent, strict=True)):
        raise Disagrees(f"{what}: {list(got)} where {list(sent)} was sent")


@contextmanager
def _running(serve: Callable[[threading.Event], None]) -> Iterator[None]:
    stop = threading.Event()
    thread = threading.Thread(target=serve, args=(stop,))
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()


_RTDE_CLIENT = """
import sys, time
from rtde_receive import RTDEReceiveInterface
client = RTDEReceiveInterface(sys.argv[1], 500.0, ["timestamp", "actual_q"])
stamps = set()
while len(stamps) < int(sys.argv[2]):
    stamps.add(client.getTimestamp())
    time.sleep(0.001)
print(*client.getActualQ())
client.disconnect()
"""
"""A process of its own, since this client lets no other thread of its process run while it connects."""


def ur_rtde() -> str:
    """SDU Robotics' client, in C++, reads our emulated controller."""
    from daq import feedback  # noqa: PLC0415
    from daq.emulators.network_ports import TcpPort  # noqa: PLC0415
    from tests.support.drivers import rtde  # noqa: PLC0415

    if find_spec("rtde_receive") is None:
        raise Absent("ur_rtde is not installed")
    address = "127.0.0.30"  # its port is fixed
    server = socket.create_server((address, 30004))
    controller = TcpPort(lambda: feedback.device(rtde(), lambda _: ANGLES_DEG), server=server)
    with _running(controller.serve):
        command = [sys.executable, "-c", _RTDE_CLIENT, address, str(ENOUGH)]
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=PATIENCE_S)
    if done.returncode:
        raise Disagrees(f"exit code {done.returncode}: {done.stderr.strip()[-200:]}")
    angles_rad = map(float, done.stdout.strip().splitlines()[-1].split())
    _hold("angles", [math.degrees(angle) for angle in angles_rad], ANGLES_DEG, 1e-9)
    return f"{ENOUGH} packets of the emulator, angles to 1e-9 deg"


def abb_egm() -> str:
    """Wason's client, with ABB's egm.proto compiled, reads our emulator; what it encodes is read by our host."""
    from abb_robot_client.egm import EGM, egm_pb2  # noqa: PLC0415

    from daq import feedback  # noqa: PLC0415
    from daq.emulators.network_ports import UdpPort  # noqa: PLC0415
    from daq.protocol.conversation import Sample  # noqa: PLC0415
    from rigs.schema.condition import ProgramState  # noqa: PLC0415
    from tests.support.drivers import egm  # noqa: PLC0415

    controller = UdpPort(lambda: feedback.device(egm(), lambda _: ANGLES_DEG), calls=True)
    client = EGM(int(controller.port.rpartition(":")[2]))
    with _running(controller.serve):
        for _ in range(ENOUGH):
            there, state = client.receive_from_robot(PATIENCE_S)
            if not there:
                raise Disagrees("nothing comes of the emulator")
            _hold("angles of the emulator", state.joint_angles, ANGLES_DEG, 1e-12)
    client.socket.close()
    host = feedback.host(egm())
    host.connected(0)
    for number in range(ENOUGH):
        robot = egm_pb2.EgmRobot()
        robot.header.seqno, robot.header.tm, robot.header.mtype = number, 4 * number, 2
        robot.feedBack.joints.joints.extend(ANGLES_DEG)
        robot.feedBack.time.sec, robot.feedBack.time.usec = 1_700_000_000, 4000 * number
        robot.motorState.state = egm_pb2.EgmMotorState.MOTORS_ON
        robot.rapidExecState.state = egm_pb2.EgmRapidCtrlExecState.RAPID_RUNNING
        (sample,) = host.received(robot.SerializeToString(), number).items
        if not isinstance(sample, Sample):
            raise Disagrees(f"our host: {sample}")
        sent = [*ANGLES_DEG, ProgramState.RUNNING, 1.0, 1.7e9 + 0.004 * number]
        _hold("our host", [*sample.values, sample.device_time_s], sent, 1e-6)
    return f"{ENOUGH} datagrams of the emulator, {ENOUGH} of the compiled egm.proto"


def roslibpy() -> str:
    """RobotWebTools' and Gramazio Kohler's client subscribes at our emulated rosbridge server."""
    import roslibpy  # noqa: PLC0415

    from daq import feedback  # noqa: PLC0415
    from daq.emulators.network_ports import TcpPort  # noqa: PLC0415
    from tests.support.drivers import PANDA, joint_states  # noqa: PLC0415

    heard: list[dict[str, Any]] = []
    server = TcpPort(lambda: feedback.device(joint_states(), lambda _: ANGLES_DEG))
    with _running(server.serve):
        client = roslibpy.Ros("127.0.0.1", int(server.port.rpartition(":")[2]))
        client.run(timeout=PATIENCE_S)
        topic = roslibpy.Topic(client, "/joint_states", "sensor_msgs/JointState")
        topic.subscribe(heard.append)
        until_s = time.monotonic() + PATIENCE_S
        while len(heard) < ENOUGH and time.monotonic() < until_s:
            time.sleep(0.01)
        client.terminate()
    if len(heard) < ENOUGH:
        raise Disagrees(f"only {len(heard)} messages in {PATIENCE_S:g} s")
    by_name = dict(zip(heard[-1]["name"], heard[-1]["position"], strict=True))
    _hold("angles", [math.degrees(by_name[name]) for name in PANDA], ANGLES_DEG, 1e-9)
    return f"{len(heard)} messages of the emulator"


def minimalmodbus() -> str:
    """MinimalModbus asks our emulated gauge on a pty, at the pace of its line."""
    import minimalmodbus  # noqa: PLC0415

    from daq import gauges  # noqa: PLC0415
    from daq.emulators.pty_line import PtyLine  # noqa: PLC0415
    from daq.wire.conversation_loop import run_conversation  # noqa: PLC0415
    from tests.support.drivers import PLAIN, modbus  # noqa: PLC0415

    gauge = modbus(**PLAIN, line="57600 8E1", word_order="big")
    line = PtyLine(gauge.line)

    def serve(stop: threading.Event) -> None:
        run_conversation(line, gauges.device([gauge], lambda _: [GAUGE_MM]), lambda _: None, stop.is_set)

    with _running(serve):
        client = minimalmodbus.Instrument(line.port, gauge.unit)
        client.serial.baudrate, client.serial.timeout = 57600, 1.0
        read = [client.read_float(gauge.value.address, functioncode=gauge.function) for _ in range(ENOUGH // 4)]
        client.serial.close()
    line.close()
    _hold("readings", read, [GAUGE_MM] * (ENOUGH // 4), 0.0)
    return f"{len(read)} float32 of the emulator on a pty"


def node_opcua() -> str:
    """node-opcua's server, with the robot of the public nodeset of OPC 40010-1, is read by our host."""
    from daq import feedback  # noqa: PLC0415
    from daq.acquisition.streams import NO_LINE  # noqa: PLC0415
    from daq.protocol.conversation import Fault, Item, Sample  # noqa: PLC0415
    from daq.wire.conversation_loop import run_conversation  # noqa: PLC0415
    from daq.wire.links import open_link  # noqa: PLC0415
    from tests.support.drivers import opc_ua  # noqa: PLC0415

    if find_spec("asyncua") is None:
        raise Absent("asyncua, which our host needs, is not installed")
    with _node_server("node_opcua_robot.js") as (port, path):
        link, items = open_link("robot", port, NO_LINE), list[Item]()
        until_s = time.monotonic() + PATIENCE_S
        host = feedback.host(opc_ua(port=port, path=path, rate_hz=20))
        run_conversation(link, host, items.extend, lambda: len(items) >= 40 or time.monotonic() > until_s)
        link.close()
    samples = [item for item in items if isinstance(item, Sample)]
    if len(samples) < 40:
        raise Disagrees(next((item.detail for item in items if isinstance(item, Fault)), "nothing comes of the server"))
    begun_s = samples[0].device_time_s - samples[0].values[0]
    for sample in samples:  # each axis moves 1 deg/s, 10 deg ahead of the one before
        since_s = sample.device_time_s - begun_s
        _hold("angles", sample.values[:6], [since_s + 10 * axis for axis in range(6)], 1e-6)
    return f"{len(samples)} positions, each at its stamp to 1e-6 deg"


@contextmanager
def _node_server(script: str) -> Iterator[tuple[str, str]]:
    """A server in JavaScript, which prints its port and path once it is ready."""
    if which("node") is None:
        raise Absent("node is not installed")
    command = ["node", str(Path(__file__).with_name(script))]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None and server.stderr is not None
        try:
            ready = next((line for line in server.stdout if line.startswith("ready ")), "")
            if not ready:
                said = server.stderr.read().strip()
                missing = "node does not find node-opcua (npm install node-opcua; NODE_PATH=.../node_modules)"
                raise Absent(missing if "MODULE_NOT_FOUND" in said else said[-200:])
            _, port, path = ready.split()
            yield f"tcp://127.0.0.1:{port}", path
        finally:
            server.kill()


PEERS = (
    Peer("ur_rtde (SDU Robotics)", ("ur_rtde",), "the emulator", ur_rtde),
    Peer("abb_robot_client with egm.proto", ("abb_egm",), "host and emulator", abb_egm),
    Peer("roslibpy", ("ros2_joint_states",), "the emulator", roslibpy),
    Peer("websockets", ("ros2_joint_states",), "the host", _tested("tests/daq/protocol/test_joint_states.py")),
    Peer("node-opcua, OPC 40010's nodeset", ("opc_ua_robotics",), "the host", node_opcua),
    Peer("asyncua's server", ("opc_ua_robotics",), "the host, with the same codec", _tested(OPC_UA_TESTS)),
    Peer("pymodbus", ("modbus_map",), "host and emulator", _tested("tests/daq/protocol/test_modbus_interop.py")),
    Peer("libmodbus", ("modbus_map",), "host", _tested("tests/daq/protocol/test_libmodbus.py")),
    Peer("MinimalModbus", ("modbus_map",), "the emulator", minimalmodbus),
)


def draw(given: Namespace) -> Iterable[Peer]:
    return PEERS


def checked(peer: Peer) -> str:
    """The line of a peer: agrees, skipped or disagrees."""
    try:
        verdict = f"agrees: {peer.check()}"
    except (Absent, ImportError) as reason:
        verdict = f"skipped: {reason}"
    except Exception as reason:  # noqa: BLE001 - a peer's own error is a disagreement like any other
        verdict = f"DISAGREES: {reason}"
    return f"{peer.name:<32} {', '.join(peer.interfaces):<45} {verdict}"


def has_failed(lines: Sequence[str]) -> bool:
    return any("DISAGREES: " in line for line in lines)


TRIAL = Trial(
    draw,
    checked,
    failed=has_failed,
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
