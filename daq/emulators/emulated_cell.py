"""Emulated cell: every instrument of a rig file on a pty or a local port, measuring a motion or playing a capture."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from daq import clock
from daq.acquisition.streams import ROBOT, Stream, streams_of
from daq.emulators.network_ports import NetworkPort, TcpCaller, TcpPort, UdpPort
from daq.emulators.pty_line import PtyLine
from daq.emulators.timed import STEADY, Punctual, Unsteady
from daq.protocol.conversation import Device
from daq.wire.conversation_loop import run_conversation
from daq.wire.links import LinkLost
from rigs.rig import Rig
from rigs.schema.links import tcp_address, udp_address
from rigs.yaml_text import data_of

_NOTICE_S = 0.05


@dataclass(frozen=True)
class Adversity:
    latency_ms: float = 0.0
    """Latency of an FTDI adapter on each serial line."""
    jitter_ms: float = 0.0
    """Mean delay of the packets of the robot."""
    drift_ppm: float = 0.0
    unsteady: Unsteady = STEADY


NONE = Adversity()


class EmulatedInstruments:
    """All instruments of a rig, each with a thread that runs until `stop`."""

    def __init__(
        self,
        rig: Rig,
        devices: Mapping[str, Callable[[], Device]],
        adversity: Adversity = NONE,
        names: Path | None = None,
        *,
        paced: bool = True,
    ) -> None:
        """Open the ports of a cell.

        devices: creates the instrument for each connection, by stream name: `g1`, `g1_g2` for a shared port, `robot`.
        names: directory for permanent names of serial ports, like those of udev. paced: as for `PtyLine`.
        """
        self._stop = clock.Event()
        self._threads: list[clock.Thread] = []
        self._devices: dict[str, list[Device]] = {}
        self._lines: list[PtyLine] = []
        self._servers: dict[str, NetworkPort] = {}
        self._plugged: dict[str, clock.Event] = {}
        self._silenced: set[str] = set()
        self.ports: dict[str, str] = {}
        """Ports by section of the rig file: `g1`, `g2`, `feedback`."""
        for stream in streams_of(rig):
            self._open_port(stream, devices[stream.name], adversity, names and names / stream.name, paced)

    def start(self) -> None:
        for thread in self._threads:
            thread.start()

    def stop(self) -> dict[str, int]:
        if self._stop.is_set():
            return self.sent()
        self._stop.set()
        for thread in self._threads:
            thread.join()
        for line in self._lines:
            line.close()
        return self.sent()

    def silence(self, name: str) -> None:
        self._silenced.add(name)

    def hang_up(self, name: str) -> None:
        self._servers[name].hang_up()

    def unplug(self, name: str) -> None:
        """Unplug an instrument: the tty and its name disappear, or the address refuses connections."""
        self._plugged[name].clear()

    def plug(self, name: str) -> None:
        """Plug an instrument in: a new tty with the same name, or the same address."""
        self._plugged[name].set()

    def sent(self) -> dict[str, int]:
        return {name: sum(device.sent for device in devices) for name, devices in self._devices.items()}

    def rig_text(self, text: str, *, emulated: bool = False) -> str:
        """Rig file with the ports of this cell. emulated: mark the robot as emulated."""
        data = data_of(as_emulated(text) if emulated else text)
        for name, port in self.ports.items():
            (data["feedback"] if name == "feedback" else data["gauges"][name])["port"] = port
        return _text_of(data)

    def _open_port(
        self, stream: Stream, make: Callable[[], Device], adversity: Adversity, link: Path | None, paced: bool
    ) -> None:
        name, late_ms = stream.name, adversity.jitter_ms
        self._devices[name] = []

        def make_device() -> Device:
            device = make()
            self._devices[name].append(device)
            return device

        server: NetworkPort | None = None
        if udp_address(stream.port):
            server = UdpPort(make_device, calls=stream.listens, jitter_ms=late_ms)
        elif tcp_address(stream.port) and stream.listens:
            server = TcpCaller(make_device, late_ms)
        elif tcp_address(stream.port):
            server = TcpPort(make_device, late_ms if name == ROBOT else 0.0)
        if server is None:
            line = PtyLine(stream.line, adversity.latency_ms, link, paced=paced)
            port = self._serve_pty(name, make_device, line, paced)
        else:
            self._servers[name], self._plugged[name], port = server, server.plugged, server.port
            self._threads.append(clock.Thread(target=server.serve, args=(self._stop,), name=f"emulated {name}"))
        called = ["feedback"] if name == ROBOT else name.split("_")
        self.ports.update(dict.fromkeys(called, port))

    def _serve_pty(self, name: str, made: Callable[[], Device], line: PtyLine, paced: bool) -> str:
        plugged = self._plugged[name] = clock.Event()
        plugged.set()
        self._lines.append(line)

        def ended() -> bool:
            return self._stop.is_set() or name in self._silenced or not plugged.is_set()

        def serve() -> None:
            while not self._stop.is_set() and name not in self._silenced:
                with contextlib.suppress(LinkLost):
                    run_conversation(line, Punctual(made(), line) if paced else made(), lambda _: None, ended)
                self._stop.wait(_NOTICE_S)
                if not plugged.is_set():
                    line.unplug()
                    while not plugged.wait(_NOTICE_S) and not self._stop.is_set():
                        pass
                    line.plug()

        self._threads.append(clock.Thread(target=serve, name=f"emulated {name}"))
        return line.port


def as_emulated(text: str) -> str:
    return _text_of(data_of(text) | {"emulated": True})


def _text_of(data: Mapping[str, Any]) -> str:
    written: str = yaml.safe_dump(dict(data), sort_keys=False, allow_unicode=True, width=110)
    return written
