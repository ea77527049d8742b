"""KUKA Robot Sensor Interface (RSI Ethernet): XML datagrams (public code; the origin lists the assumptions).

The controller sends `<Rob Type="KUKA"> … <AIPos A1= … A6=/> … <IPOC>n</IPOC></Rob>` every cycle to the address in the
Ethernet configuration, from a new port after each program start. It requires an answer with the same IPOC in the same
cycle, and stops the program after several late or missing answers. The answer contains no correction, which means a
correction of zero. Every datagram with a readable IPOC is answered, even if the rest is invalid, because the robot must
not stop. The decoder searches the elements by regular expressions, without entities, DTD and nesting: no text can
expand.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from functools import partial

from daq.feedback import Read
from daq.protocol.conversation import ConversationStep, Device, Fault, FaultKind, Host
from daq.protocol.framing import Message
from daq.protocol.numerals import number, plausible
from daq.protocol.positions import Order, Position, Positions, SteadyDevice, UnusableDatagram
from daq.protocol.streamed import Reaction, Streamed
from rigs.schema.feedback import KUKARSI

_ROB = re.compile(rb"\s*(<\?xml[^<>]*\?>\s*)?<Rob\b[^<>]*>.*</Rob>\s*", re.DOTALL)
_IPOC = re.compile(rb"<IPOC>\s*(\d{1,18})\s*</IPOC>")
_JOINTS = re.compile(rb"<AIPos\b([^<>]*)>")
_JOINT = re.compile(rb"\bA([1-6])\s*=\s*\"\s*([^\"<>&\s]{1,40})\s*\"")
_DELAY = re.compile(rb"<Delay\s+D\s*=\s*\"(\d{1,9})\"")
_IPOC_WRAP = 2**63
"""The counter increases while the controller is on, and never approaches 18 digits."""


def host(feedback: KUKARSI) -> Host:
    return Streamed(_RSIDialect(feedback), feedback.timeout_s)


def device(feedback: KUKARSI, read: Read) -> Device:
    return _RSIController(feedback, read)


def _answer(sentype: str, ipoc: str) -> bytes:
    return f'<Sen Type="{sentype}"><IPOC>{ipoc}</IPOC></Sen>'.encode()


def _decode(tags: Sequence[re.Pattern[bytes]], data: bytes) -> Position | UnusableDatagram:
    ipoc, joints = _IPOC.findall(data), _JOINTS.findall(data)
    if not _ROB.fullmatch(data) or len(ipoc) != 1:
        return UnusableDatagram(FaultKind.GARBLED, f"{data[:80]!r} is not a <Rob> with a single <IPOC>")
    if not joints:
        return UnusableDatagram(
            FaultKind.MISSING, "<AIPos> is missing; add DEF_AIPos to SEND in the Ethernet configuration"
        )
    angles = sorted(_JOINT.findall(joints[0]))
    read = [number(value.decode("ascii", "replace")) for _, value in angles]
    angles_deg = tuple(value for value in read if value is not None)
    if b"".join(axis for axis, _ in angles) != b"123456" or len(angles_deg) != 6 or len(joints) != 1:
        return UnusableDatagram(
            FaultKind.GARBLED, f"<AIPos{joints[0][:200].decode('ascii', 'replace')}> does not contain six numbers"
        )
    texts = (match[1].decode("ascii", "replace") if (match := tag.search(data)) else "" for tag in tags)
    values = (number(text) for text in texts)
    return Position(
        angles_deg,
        int(ipoc[0]) / 1000,
        int(ipoc[0]),
        tuple(math.nan if value is None else plausible(value) for value in values),
    )


class _RSIDialect(Positions):
    def __init__(self, feedback: KUKARSI) -> None:
        check = "check that the program with RSI_ON is running, and that the controller sends to this address"
        # Expressions for the parts of the condition: an element or an attribute
        expressions = []
        for tag in feedback.condition.values():
            element, _, attribute = (re.escape(part).encode() for part in tag.partition("."))
            value = rb"\s*([^\s\"<>&]{1,40})\s*"
            if attribute:
                expressions.append(re.compile(rb"<%b\s(?:[^<>]*\s)?%b\s*=\s*\"%b\"" % (element, attribute, value)))
            else:
                expressions.append(re.compile(rb"<%b>%b</%b>" % (element, value, element)))
        super().__init__(partial(_decode, expressions), check, Order(feedback.cycle_ms, _IPOC_WRAP))
        self._onlysend = feedback.onlysend
        self._sentype = feedback.sentype
        self._delays = 0

    def read(self, message: Message) -> Reaction:
        reaction = super().read(message)
        if self._onlysend:
            return reaction
        ipoc = _IPOC.search(message.data)
        answer = _answer(self._sentype, ipoc[1].decode("ascii")) if ipoc else b""
        # The controller counts answers that are missing in their cycle.
        counted, late = _DELAY.search(message.data), list[Fault]()
        before, self._delays = self._delays, int(counted[1]) if counted else 0
        if self._delays > before:
            detail = "the controller found answers late, and stops its program after too many; lower this host's load"
            late = [message.fault(FaultKind.DEVICE_ERROR, detail, self._delays - before)]
        return Reaction((*reaction.items, *late), answer)


class _RSIController(SteadyDevice):
    IPOC_START = 4_208_000

    def __init__(self, feedback: KUKARSI, read: Read) -> None:
        super().__init__(read, 1000 / feedback.cycle_ms)
        self._feedback = feedback
        self._ticked_ns = 0
        self._awaited: dict[int, int] = {}
        self._delays = 0

    def received(self, data: bytes, now_ns: int) -> ConversationStep:
        for ipoc in list(self._awaited):
            if data == _answer(self._feedback.sentype, str(ipoc)):
                del self._awaited[ipoc]
                self._delays = 0
        return self._step()

    def tick(self, now_ns: int) -> ConversationStep:
        self._ticked_ns = now_ns
        return super().tick(now_ns)

    def _message(self, instant_ns: int) -> bytes:
        for ipoc, sent_ns in list(self._awaited.items()):
            if self._ticked_ns - sent_ns >= self._feedback.cycle_ms * 1_000_000:
                del self._awaited[ipoc]
                self._delays += 1
        ipoc = self.IPOC_START + round((instant_ns - self._connected_ns) / 1e6)
        if not self._feedback.onlysend:
            self._awaited[ipoc] = self._ticked_ns
        shown = self._read(instant_ns)
        joints = " ".join(f'A{axis}="{angle:.5f}"' for axis, angle in enumerate(shown[:6], 1))
        condition = ""
        for tag, value in zip(self._feedback.condition.values(), shown[6:], strict=False):
            element, _, attribute = tag.partition(".")
            shows = f' {attribute}="{value:.3f}"/>' if attribute else f">{value:.3f}</{element}>"
            condition += f"<{element}{shows}"
        pose = " ".join(f'{name}="0.00000"' for name in "XYZABC")
        delay = f'<Delay D="{self._delays}"/><IPOC>{ipoc}</IPOC>'
        return f'<Rob Type="KUKA"><RIst {pose}/><AIPos {joints}/>{condition}{delay}</Rob>'.encode()
