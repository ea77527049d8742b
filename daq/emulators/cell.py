"""An emulated cell: every instrument of a rig file on a pty or a local port.

What the instruments show comes from a `Motion`, so that this package needs no kinematics.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Protocol

import yaml

from daq import feedback, gauges
from daq.emulators.own_clock import OwnClock
from daq.emulators.pty_line import PtyLine
from daq.emulators.tcp_port import TcpPort
from daq.emulators.udp_port import UdpPort
from daq.links import LinkLost
from daq.protocol.conversation import Conversation, Device
from daq.runner import converse
from daq.streams import gauge_groups
from rigs.feedback import carries_signal
from rigs.links import tcp_address, udp_address
from rigs.rig import Rig

_NOTICE_S = 0.05


class Motion(Protocol):
    """What the emulated instruments measure, at any time of the host's monotonic clock."""

    def gauge_mm(self, name: str, now_ns: int) -> float:
        """Reading of the gauge of that name; nan where its head is off."""

    def joints_deg(self, now_ns: int) -> Sequence[float]:
        """The six joint angles that the controller reports."""


class Server(Protocol):
    """A local port that an emulated instrument is behind."""

    port: str
    """As a rig file names it."""
    plugged: threading.Event
    """Cleared while its cable is pulled."""

    def serve(self, stop: threading.Event) -> None:
        """Until `stop` is set."""

    def hang_up(self) -> None:
        """End the conversation there is, and begin another."""


def gauge_device(rig: Rig, motion: Motion, group: Sequence[str]) -> Callable[[], Device]:
    """What makes the instrument that these gauges share, for each connection anew."""

    def read(now_ns: int) -> Sequence[float]:
        return [motion.gauge_mm(name, now_ns) for name in group]

    return partial(gauges.device, [gauge for name, gauge in rig.gauges if name in group], read)


@dataclass(frozen=True)
class Adversity:
    """What keeps stamps from being true. latency_ms: how long an FTDI adapter on each serial line holds bytes;
    jitter_ms: how late the robot's packets are on average; drift_ppm: how fast its controller's clock runs."""

    latency_ms: float = 0.0
    jitter_ms: float = 0.0
    drift_ppm: float = 0.0


class Cell:
    """All instruments of a rig, each with its own thread, until `stop`.

    signal: number of the robot's program at a time, shown where the rig's feedback carries one. names: a directory
    where serial ports get names that outlast their ttys, as udev makes them. An instrument is called as its stream:
    `g1`, `g1_g2` where two share a port, `robot`.
    """

    def __init__(
        self,
        rig: Rig,
        motion: Motion,
        signal: Callable[[int], float] = lambda _: 0.0,
        adversity: Adversity = Adversity(),
        names: Path | None = None,
    ) -> None:
        self._stop = threading.Event()
        self._threads: list[threading.Thread] = []
        self._devices: dict[str, list[Any]] = {}
        self._lines: list[PtyLine] = []
        self._servers: dict[str, Server] = {}
        self._plugged: dict[str, threading.Event] = {}
        self._silenced: set[str] = set()
        self.ports: dict[str, str] = {}
        members = dict(rig.gauges)
        for group in gauge_groups(rig):
            first, label = members[group[0]], "_".join(group)
            device = gauge_device(rig, motion, group)
            port = (
                self._serve(label, TcpPort(self._noted(label, device)))
                if tcp_address(first.port)
                else self._serve_pty(label, device, PtyLine(first.line, adversity.latency_ms, names and names / label))
            )
            self.ports.update(dict.fromkeys(group, port))

        def shown(now_ns: int) -> Sequence[float]:
            program = (signal(now_ns),) if carries_signal(rig.feedback) else ()
            return [*motion.joints_deg(now_ns), *program]

        def controller() -> Any:
            return OwnClock(partial(feedback.device, rig.feedback), shown, adversity.drift_ppm)

        robot, late_ms = self._noted("robot", controller), adversity.jitter_ms
        calls, by_udp = rig.feedback.listens, udp_address(rig.feedback.port)
        networked = UdpPort(robot, calls=calls, jitter_ms=late_ms) if by_udp else TcpPort(robot, late_ms)
        self.ports["feedback"] = self._serve("robot", networked)

    def start(self) -> None:
        """Switch everything on."""
        for thread in self._threads:
            thread.start()

    def stop(self) -> dict[str, int]:
        """Switch everything off, once; returns how many readings each instrument had sent."""
        if self._stop.is_set():
            return self.sent()
        self._stop.set()
        for thread in self._threads:
            thread.join()
        for line in self._lines:
            line.close()
        return self.sent()

    def silence(self, name: str) -> None:
        """The instrument on this serial line says nothing any more."""
        self._silenced.add(name)

    def hang_up(self, name: str) -> None:
        """The instrument on this network port ends its conversation, and takes up a new one."""
        self._servers[name].hang_up()

    def unplug(self, name: str) -> None:
        """The instrument's cable is pulled: its tty and its name are gone, or its address refuses."""
        self._plugged[name].clear()

    def plug(self, name: str) -> None:
        """The cable is back: another tty under the same name, or the same address."""
        self._plugged[name].set()

    def sent(self) -> dict[str, int]:
        """Readings sent so far, by stream."""
        return {name: sum(device.sent for device in devices) for name, devices in self._devices.items()}

    def rig_text(self, text: str) -> str:
        """A rig file's text with the ports of this cell in place of its own."""
        data = yaml.safe_load(text)
        for name, port in self.ports.items():
            (data["feedback"] if name == "feedback" else data["gauges"][name])["port"] = port
        written: str = yaml.safe_dump(data, sort_keys=False, allow_unicode=True, width=110)
        return written

    def _noted(self, name: str, make: Callable[[], Conversation]) -> Callable[[], Conversation]:
        self._devices[name] = []

        def made() -> Conversation:
            device = make()
            self._devices[name].append(device)
            return device

        return made

    def _serve(self, name: str, server: Server) -> str:
        self._servers[name] = server
        self._plugged[name] = server.plugged
        self._threads.append(threading.Thread(target=server.serve, args=(self._stop,), name=f"emulated {name}"))
        return server.port

    def _serve_pty(self, name: str, make: Callable[[], Conversation], line: PtyLine) -> str:
        made = self._noted(name, make)
        plugged = self._plugged[name] = threading.Event()
        plugged.set()
        self._lines.append(line)

        def ended() -> bool:
            return self._stop.is_set() or name in self._silenced or not plugged.is_set()

        def serve() -> None:
            while not self._stop.is_set() and name not in self._silenced:
                with contextlib.suppress(LinkLost):
                    converse(line, made(), lambda _: None, ended)
                if not plugged.is_set():
                    line.unplug()
                    while not plugged.wait(_NOTICE_S) and not self._stop.is_set():
                        pass
                    line.plug()

        self._threads.append(threading.Thread(target=serve, name=f"emulated {name}"))
        return line.port
