"""Cell and daemon in simulated time: emulated instruments, lines in memory, and the disk of this computer."""

from __future__ import annotations

import contextlib
import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from daq import clock
from daq.acquisition.streams import streams_of
from daq.emulators.instruments import MotionSource, instruments_of
from daq.emulators.simulated_clock import SimulatedClock, close_files_in
from daq.protocol.conversation import Device, Fault, Item
from daq.service.daemon import Daemon
from daq.wire.conversation_loop import run_conversation
from daq.wire.links import LinkLost
from rigs.errors import CellError
from rigs.load import parse
from rigs.schema.links import udp_address

_NETWORK_NS = 100_000
_ROUND_S = 0.2


class SimulatedLine:
    def __init__(self, name: str, character_ns: int, *, datagrams: bool = False) -> None:
        """character_ns: 0 for a network. datagrams: a read returns exactly one datagram."""
        self.name, self.plugged, self.datagrams = name, True, datagrams
        self.change: Callable[[bytes], tuple[bytes, int]] = lambda data: (data, 0)
        """Modifies the data of the instrument, and returns an additional delay in ns."""
        self.sent: Callable[[bytes, bytes, int, int], Callable[[], None]] = lambda *_: _nothing
        """Called with each piece before and after the change, its arrival time and its delay.

        The function that it returns is called when the daemon reads the piece.
        """
        self.connections = 0
        self.ends: tuple[_LineEnd, _LineEnd] | None = None
        """Ends of the daemon and of the instrument while the link is open."""
        self._character_ns = character_ns

    def open(self) -> _LineEnd:
        if not self.plugged:
            raise CellError(self.name, "does not exist", "plug it in", code="port.missing")
        ours, theirs = _LineEnd(self, self._character_ns), _LineEnd(self, self._character_ns)
        ours.other, theirs.other, self.ends = theirs, ours, (ours, theirs)
        theirs.sends_changed = True
        self.connections += 1
        return ours

    def serve(self, make: Callable[[], Device], made: list[Device]) -> None:
        def serve() -> None:
            while True:
                if self.ends is None:
                    clock.sleep(_ROUND_S)
                    continue
                end = self.ends[1]
                made.append(make())
                with contextlib.suppress(LinkLost):
                    # An idle instrument does not wake up, which makes quiet hours cheap.
                    run_conversation(end, made[-1], lambda _: None, lambda: False, longest_s=math.inf)
                if self.ends and self.ends[1] is end:
                    self.reset()

        clock.Thread(target=serve, name=f"emulated {self.name}", daemon=True).start()

    def unplug(self) -> None:
        self.plugged = False
        self.reset()

    def reset(self) -> None:
        for end in self.ends or ():
            end.lost = True
        self.ends = None


class _LineEnd:
    """An end of a line, used in place of `daq.wire.links.Link`."""

    def __init__(self, line: SimulatedLine, character_ns: int) -> None:
        self.name, self.lost, self.sends_changed = line.name, False, False
        self.other: _LineEnd = self
        self._line, self._character_ns = line, character_ns
        self.coming: deque[tuple[int, bytes, Callable[[], None]]] = deque()
        self._free_ns = 0

    def read(self, timeout_s: float) -> bytes:
        until_ns = clock.now_ns() + max(0.0, timeout_s) * 1e9
        if timeout_s <= 0:
            clock.sleep(0)  # a system call takes some time
        while not (self.coming and self.coming[0][0] <= clock.now_ns()):
            if self.lost:
                raise LinkLost("unplugged")
            if clock.now_ns() >= until_ns:
                return b""
            self._wait(min(until_ns, self.coming[0][0]) if self.coming else until_ns)
        data = b""
        while self.coming and self.coming[0][0] <= clock.now_ns():
            _, piece, note_read = self.coming.popleft()
            data += piece
            note_read()
            if self._line.datagrams:
                break
        return data

    def _wait(self, until_ns: float) -> None:
        count, event = len(self.coming), clock.Event()
        event.is_set = lambda: self.lost or len(self.coming) > count  # type: ignore[method-assign]
        event.wait(None if until_ns == math.inf else (until_ns - clock.now_ns()) / 1e9)

    def write(self, data: bytes) -> None:
        if self.lost:
            raise LinkLost("unplugged")
        changed, later_ns = self._line.change(data) if self.sends_changed else (data, 0)
        self._free_ns = max(self._free_ns, clock.now_ns()) + len(changed) * self._character_ns
        at_ns = self._free_ns + later_ns + (0 if self._character_ns else _NETWORK_NS)
        at_ns = max(at_ns, self.other.coming[-1][0] if self.other.coming else 0)
        note_read = self._line.sent(data, changed, at_ns, later_ns) if self.sends_changed else _nothing
        if changed:
            self.other.coming.append((at_ns, changed, note_read))
        if self.sends_changed:  # an instrument waits for the line; the port of a computer has a buffer
            clock.sleep(max(0, self._free_ns - clock.now_ns()) / 1e9)

    def set_dtr(self, on: bool) -> None:
        pass

    def close(self) -> None:
        self.lost = self.other.lost = True

    def note_items(self, items: Sequence[Item]) -> None:
        pass

    def take_ignored(self) -> list[Fault]:
        return []


class SimulatedCell:
    def __init__(
        self,
        time: SimulatedClock,
        folder: Path,
        text: str,
        motion: MotionSource,
        signal: Callable[[int], float],
        devices: Mapping[str, Callable[[], Device]] | None = None,
    ) -> None:
        """Start the instruments of a rig. devices: factories by stream in place of the default instruments."""
        self.time, self.folder, self.text = time, folder, text
        self.rig = parse(text, "simulated")
        self.lines: dict[str, SimulatedLine] = {}
        self.made: dict[str, list[Device]] = {}
        self.daemons = 0
        devices = devices or instruments_of(self.rig, motion, signal)
        with time.process("cell"):
            for stream in streams_of(self.rig):
                pace_ns = 0 if "://" in stream.port else stream.line.character_ns
                by_udp = udp_address(stream.port) is not None
                line = self.lines[stream.name] = SimulatedLine(stream.name, pace_ns, datagrams=by_udp)
                made = self.made[stream.name] = []
                line.serve(devices[stream.name], made)

    def daemon(self, **options: Any) -> Daemon:
        self.daemons += 1
        socket = self.folder / "rigd" / f"{self.rig.name}.sock"
        socket.parent.mkdir(exist_ok=True)
        opened = Daemon(self.rig, self.text, self.folder / "runs", socket, opening=self._open, **options)
        with self.time.process(f"rigd {self.daemons}"):
            opened.start()
        return opened

    def kill(self, daemon: Daemon) -> None:
        """Kill a daemon. All threads end immediately, and the files and lines are closed."""
        self.time.kill(f"rigd {self.daemons}")
        daemon._control.close()  # private: what a kill closes
        daemon._locks.close()
        for line in self.lines.values():
            line.reset()
        close_files_in(self.folder)

    def _open(self, name: str, *_: object, **__: object) -> Any:
        return self.lines[name].open()


def _nothing() -> None:
    pass
