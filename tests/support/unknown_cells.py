"""Emulated cells without a rig file, to be identified by `rig init`."""

from __future__ import annotations

import os
import select
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from daq.emulators.emulated_cell import EmulatedInstruments
from daq.emulators.instruments import MotionSource, emulated
from rigs.load import SHIPPED, parse
from tests.support.bench import PATIENCE_S, ByHand
from tests.support.drivers import OPC_UA

_BAUMER = {
    key: value
    for key, value in yaml.safe_load((SHIPPED / "ur10e-cell.yaml").read_text())["gauges"]["g1"].items()
    if key != "port"
}
_ILD = {"interface": "micro_epsilon_ild1420", "range_mm": 10, "zero_mm": 5}
_PLAIN = {"status": None, "clock_s": None, "clock_us": None}
GAUGES: dict[str, list[dict[str, Any]]] = {
    "sylvac": [{"interface": "sylvac_opto_rs"}] * 2,
    "keyence": [{"interface": "keyence_dl_rs1a", "port": "/dev/one", "channel": channel} for channel in (1, 2)],
    "modbus": [_BAUMER] * 2,
    "other registers at": [{**_BAUMER, "address": 300, "value": {"address": 302, "type": "float32"}, **_PLAIN}],
    "modbus unit 7 at": [{**_BAUMER, "unit": 7}],
    "micro_epsilon": [_ILD] * 2,
    "keyence at 38400": [
        {"interface": "keyence_dl_rs1a", "port": "/dev/one", "channel": channel, "line": "38400 8N1"}
        for channel in (1, 2)
    ],
    "tesa": [{"interface": "tesa_tt"}],
}
"""Gauges as in a rig file."""
ROBOTS: dict[str, dict[str, Any]] = {
    "ur": {"interface": "ur_rtde", "port": "tcp://127.0.0.1:30004"},
    "fanuc": {"interface": "line_feed", "port": "tcp://127.0.0.1:59002"},
    "kuka": {"interface": "kuka_rsi", "port": "udp://127.0.0.1:49152", "cycle_ms": 12},
    "abb": {"interface": "abb_egm", "port": "udp://127.0.0.1:6510"},
    "stream motion": {"interface": "fanuc_stream_motion", "port": "udp://127.0.0.1:60015"},
}
if OPC_UA:
    ROBOTS["opc ua"] = {"interface": "opc_ua_robotics", "port": "tcp://127.0.0.1:4840"}


def cell_text(gauges: str, robot: str, speed_mm_s: float = 25) -> str:
    """Rig file of a cell with a circle speed, as ground truth for `rig init`."""
    data = yaml.safe_load((SHIPPED / "ur10e-cell.yaml").read_text())
    data["name"] = "unknown"
    data["tests"]["circle"] |= {"laps": 1, "speed_mm_s": speed_mm_s}
    data["feedback"] = ROBOTS[robot]
    data["gauges"] = {
        f"g{number}": {"port": f"/dev/{number}", **gauge, "offset_mm": 25 if number == 1 else -25}
        for number, gauge in enumerate(GAUGES[gauges], 1)
    }
    return yaml.safe_dump(data)


def named_robot(kind: str) -> list[str]:
    """Options that name the interface of a robot that is identifiable only by its port."""
    return (
        ["--key", f"feedback.interface={ROBOTS[kind]['interface']}"]
        if kind in ("ur", "stream motion", "opc ua")
        else []
    )


@dataclass
class Pushed:
    """Gauges that measure a motion and can also be pushed by a distance in mm."""

    motion: MotionSource
    by_mm: dict[str, float] = field(default_factory=dict)

    def gauge_mm(self, name: str, now_ns: int) -> float:
        return self.motion.gauge_mm(name, now_ns) + self.by_mm.get(name, 0.0)

    def joints_deg(self, now_ns: int) -> Sequence[float]:
        return self.motion.joints_deg(now_ns)


@dataclass
class UnknownCell:
    """A running cell whose readings are set by the test. robot_kind: key of `ROBOTS`."""

    cell: EmulatedInstruments
    robot_kind: str
    hand: ByHand = field(default_factory=ByHand)

    @property
    def gauge_ports(self) -> list[str]:
        """Distinct ports of the gauges."""
        return list(dict.fromkeys(port for name, port in self.cell.ports.items() if name != "feedback"))

    @property
    def robot(self) -> str:
        return self.cell.ports["feedback"]

    @property
    def robot_is_named(self) -> list[str]:
        """Options that name the interface. An emulated robot does not have its standard port."""
        return named_robot(self.robot_kind)


@contextmanager
def switched_on(gauges: str = "sylvac", robot: str = "ur", *, streaming: bool = True) -> Iterator[UnknownCell]:
    """Run a cell within the context. streaming: whether laser sensors were configured to send continuously."""
    hand = ByHand()
    made = UnknownCell(emulated(parse(cell_text(gauges, robot), "unknown"), hand), robot, hand)
    made.cell.start()
    try:
        if robot == "stream motion":
            _wait_until_bound(made.robot)
        if gauges == "micro_epsilon" and streaming:
            for port in made.gauge_ports:
                make_it_stream(port, b"OUTPUT RS422\n")
        yield made
    finally:
        made.cell.stop()


def _wait_until_bound(address: str) -> None:
    """Wait until the controller has bound its port, which a search could otherwise occupy."""
    number = f":{int(address.rpartition(':')[2]):04X} "
    while number not in Path("/proc/net/udp").read_text():
        threading.Event().wait(0.01)


def make_it_stream(port: str, command: bytes) -> None:
    """Send a configuration command to an instrument and wait until it streams."""
    fd = os.open(port, os.O_RDWR | os.O_NOCTTY)
    os.write(fd, command)
    assert select.select([fd], [], [], PATIENCE_S)[0]
    os.close(fd)
