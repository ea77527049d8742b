"""The safety mode of a Universal Robots controller, by one more RTDE recipe: in protective stop it will not drive.

`safety_mode` is an INT32 output of RTDE; its numbers are those of UR's client interfaces (SafetyMode of
ur_dashboard_msgs). A controller that does not know the field says so, and nothing is reported. The driver of the
recorder does not ask for it, since a run needs the joints alone.
"""

from __future__ import annotations

import struct
from functools import partial

from daq.acquisition.streams import NO_LINE, ROBOT, Stream
from daq.doctor.trial import try_line
from daq.feedback.ur_rtde import VERSION, packet, packets
from daq.protocol.conversation import NO_TIME, Fault, Sample
from daq.protocol.framing import Message
from daq.protocol.streamed import Reaction, Streamed

_RATE_HZ = 10.0
_PATIENCE_S = 1.5
STOPPED = {
    3: "protective stop; find out why, then unlock it on the pendant",
    4: "recovery mode; move the robot back inside its limits",
    5: "safeguard stop; close the safety gate and reset it",
    6: "emergency stop of the system; release it and switch the robot on again",
    7: "emergency stop of the robot; release it and switch the robot on again",
    8: "a safety violation; restart the controller",
    9: "a safety fault; restart the controller",
}
"""Modes in which no program runs, and what ends them."""


def stopped_by(port: str) -> str:
    """Return why a controller runs no program, and what to do; empty where it may run or does not say."""
    host = partial(Streamed, _SafetyMode(), _PATIENCE_S)
    trial = try_line(Stream(ROBOT, (), port, NO_LINE, host), NO_LINE, _PATIENCE_S, 0.0)
    return STOPPED.get(int(trial.samples[-1].values[0]), "") if trial.samples else ""


class _SafetyMode:
    """The handshake, then the mode."""

    check = "check that RTDE is enabled"

    def __init__(self) -> None:
        self.frames = packets()
        self._next = {
            b"V": packet(b"O", struct.pack(">d", _RATE_HZ) + b"safety_mode"),
            b"O": packet(b"S"),
        }

    def start(self) -> bytes:
        return packet(b"V", VERSION)

    def silent(self) -> Reaction:
        return Reaction(hang_up=True)

    def read(self, message: Message | Fault) -> Reaction:
        if isinstance(message, Fault):
            return Reaction((message,), hang_up=True)
        kind, payload = message.data[2:3], message.data[3:]
        if kind == b"O" and not payload.endswith(b"INT32"):
            return Reaction(hang_up=True)
        if kind == b"U" and len(payload) == 5:
            (mode,) = struct.unpack(">i", payload[1:])
            stamps = (NO_TIME, message.first_byte_ns, message.last_byte_ns)
            return Reaction((Sample((float(mode),), *stamps, message.size),))
        return Reaction(send=self._next.get(kind, b""))
