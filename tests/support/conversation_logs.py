"""Recorded conversations of the drivers: two files of tests/daq/conversations for each interface.

`NAME.log` has a section for each conversation: a title, the peers, and both sides.

    # a silence ends the counting
    gauge INTERFACE {KEYS}    rig reads this gauge, or this `robot`; rig plays an `emulated gauge` or `emulated robot`
    = 1.5 nan                 the next values that an emulated instrument measures
    500 < BYTES               bytes come after 500 ms
    500 .                     no byte arrives until 500 ms, when the driver had asked to be called
    > BYTES                   the driver sends these bytes
    ~ 750                     the driver asks to be called at 750 ms if no byte arrives; `x`: it closes the connection
    ? BYTES                   an alternative reply after the inputs so far, in a conversation of its own

`NAME.readings` lists the results of each section: the values of a sample with its times in ms, or a fault.
`python -m tests.support.conversation_logs` writes both files from the inputs with the present drivers. Compare each
changed reading with the manual of the instrument before you commit it: the test only shows that nothing changed.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from unittest.mock import patch

from pydantic import TypeAdapter

import daq.feedback
import daq.gauges
from daq.acquisition.streams import robot_stream
from daq.protocol.conversation import NO_TIME, Conversation, Fault, Item, Sample
from rigs.schema.feedback import Feedback
from tests.support.drivers import gauge
from tests.support.simulated_conversation import Script

FOLDER = Path(__file__).parents[1] / "daq" / "conversations"
_ROBOT: TypeAdapter[Any] = TypeAdapter(Feedback)


@dataclass
class Section:
    """A conversation: the peers, then inputs as (ms, bytes or None for a tick), and replies to try after them."""

    title: str
    peers: list[str] = field(default_factory=list)
    measured: list[list[float]] = field(default_factory=list)
    inputs: list[tuple[float, bytes | None]] = field(default_factory=list)
    replies: list[bytes] = field(default_factory=list)

    @property
    def models(self) -> list[Any]:
        """Gauges or the robot of the rig file."""
        found = []
        for line in self.peers:
            kind, interface, keys = [*line.removeprefix("emulated ").split(" ", 2), "{}"][:3]
            values = json.loads(keys)
            robot = {"interface": interface} | values
            found.append(gauge(interface, **values) if kind == "gauge" else _ROBOT.validate_python(robot))
        return found

    def conversation(self) -> Conversation:
        models, measured = self.models, list(self.measured)

        def read(now_ns: int) -> list[float]:
            return measured.pop(0) if len(measured) > 1 else measured[0]

        is_emulated = self.peers[0].startswith("emulated")
        drivers, given = (daq.feedback, models[0]) if self.is_of_robot else (daq.gauges, models)
        return drivers.device(given, read) if is_emulated else drivers.host(given)  # type: ignore[attr-defined]

    @property
    def is_of_robot(self) -> bool:
        return "robot" in self.peers[0].split()[:2]

    @property
    def is_stream(self) -> bool:
        """True if rig reads a byte stream, whose messages may arrive in any pieces."""
        return not self.peers[0].startswith("emulated") and "udp://" not in self.peers[0]

    def begun(self) -> Script:
        """The conversation after all inputs."""
        with patch("os.urandom", bytes):
            script = Script(self.conversation())
            for _ in self._played(script):
                pass
        script.sent = b""
        script.taken()
        return script

    def _played(self, script: Script) -> Iterator[str]:
        """Give the inputs; yield the lines of the log."""
        yield from _answer(script)
        for at_ms, data in self.inputs:
            script.sent = b""
            if data is None:
                script.wake()
                yield f"{_ms(script.now_ns)} ."
            else:
                script.receive(data, round(at_ms * 1e6))
                yield f"{_ms(script.now_ns)} < {_text(data)}"
            yield from _answer(script)

    def transcript(self) -> tuple[str, str]:
        """Log and readings of the section by the present drivers."""
        script = Script(self.conversation())
        log = [f"# {self.title}", *self.peers, *(f"= {' '.join(map(_number, one))}" for one in self.measured)]
        log += self._played(script)
        readings = [f"# {self.title}", *map(self._reading, script.taken())]
        for reply in self.replies:
            alone = self.begun()
            alone.receive(reply, alone.now_ns)
            log += [f"? {_text(reply)}", *_answer(alone)]
            readings.append("; ".join(map(self._reading, alone.taken())) or "nothing")
        return "\n".join(log) + "\n", "\n".join(readings) + "\n"

    def _reading(self, item: Item) -> str:
        if isinstance(item, Fault):
            return f"{item.kind}{f' × {item.count}' if item.count != 1 else ''}: {item.detail}"
        assert isinstance(item, Sample)
        values, beside = [*map(_number, item.values)], []
        if self.is_of_robot:
            columns = robot_stream(self.models[0]).columns[6:]
            beside = [f"{name} {value}" for name, value in zip(columns, values[6:], strict=True)]
        parts = [" ".join(values[: len(values) - len(beside)]), *beside]
        came = dict.fromkeys([_ms(item.first_byte_ns), _ms(item.last_byte_ns)])
        parts += [f"{' to '.join(came)} ms", f"{item.size} bytes"]
        parts += [f"asked at {_ms(item.requested_ns)}"] * (item.requested_ns != NO_TIME)
        parts += [f"clock {item.device_time_s:.13g} s"] * (not math.isnan(item.device_time_s))
        return ", ".join([*parts, *[f"status {item.status}"] * bool(item.status)])


def _answer(script: Script) -> Iterator[str]:
    if script.sent:
        yield f"> {_text(script.sent)}"
    if script.step.wake_ns is not None:
        yield f"~ {_ms(script.step.wake_ns)}"
    if script.step.hang_up:
        yield "x"


def _number(value: float) -> str:
    return f"{value:.9g}"


def _ms(time_ns: int) -> str:
    return f"{time_ns / 1e6:.6f}".rstrip("0").rstrip(".")


def _text(data: bytes) -> str:
    """Bytes as in Python source, without quotes; in hexadecimal if few of them are printable."""
    text = data.decode("latin1").encode("unicode_escape").decode("ascii")
    return text if len(text) <= 2 * len(data) + 2 else f"0x{data.hex()}"


def _bytes(text: str) -> bytes:
    if text.startswith("0x"):
        return bytes.fromhex(text[2:])
    return text.encode("ascii").decode("unicode_escape").encode("latin1")


def sections_of(log: Path) -> list[Section]:
    """The inputs of a log."""
    found: list[Section] = []
    for line in filter(None, log.read_text(encoding="ascii").splitlines()):
        first, _, rest = line.partition(" ")
        if first == "#":
            found.append(Section(rest))
        elif first in ("gauge", "robot", "emulated"):
            found[-1].peers.append(line)
        elif first == "=":
            found[-1].measured.append([float(value) for value in rest.split()])
        elif first == "?":
            found[-1].replies.append(_bytes(rest))
        elif first not in (">", "~", "x"):
            data = None if rest == "." else _bytes(rest[2:])
            found[-1].inputs.append((float(first), data))
    return found


LOGS = {log.stem: sections_of(log) for log in sorted(FOLDER.glob("*.log"))}


def written(sections: Sequence[Section]) -> tuple[str, str]:
    """Contents of both files of an interface. Random keys and masks of WebSockets are zero."""
    with patch("os.urandom", bytes):
        logs, readings = zip(*(one.transcript() for one in sections), strict=True)
    return "\n".join(logs), "\n".join(readings)


def main() -> None:
    for name, sections in LOGS.items():
        for suffix, text in zip((".log", ".readings"), written(sections), strict=True):
            (FOLDER / f"{name}{suffix}").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
