"""Lines of LinuxCNC's `halsampler -t`, one for each period of the servo thread.

`rig init --robot linuxcnc://HOST` writes the HAL lines and the program that serves them. A line contains, separated by
blanks: the sample number, the positions of joints 0 to 5 in degrees (`joint.N.pos-fb`), whether all joints are homed,
`motion.analog-out-00` and the number of samples lost so far (the pin `overruns`). The clock is the number of servo
periods, the sum of both numbers: in 2.9.0 the sampler numbers only the samples that it stores.
"""

from __future__ import annotations

from functools import partial

from daq.feedback import Read
from daq.protocol.conversation import Device, FaultKind, Host
from daq.protocol.framing import DelimitedLines
from daq.protocol.numerals import number, plausible
from daq.protocol.positions import Order, Position, Positions, SteadyDevice, UnusableDatagram
from daq.protocol.streamed import Streamed
from rigs.schema.feedback import LinuxCNC

_FIELDS = 10
_OVERRUN = b"overrun"
"""Line by which halsampler marks a gap; the numbers state its size."""


def host(feedback: LinuxCNC) -> Host:
    decode = partial(_decode, feedback.servo_period_ms / 1e3)
    check = "check that LinuxCNC runs and loads rig.hal"
    return Streamed(Positions(decode, check, Order(), frames=DelimitedLines(b"\n")), feedback.timeout_s)


def device(feedback: LinuxCNC, read: Read) -> Device:
    return _Sampler(feedback, read)


def _decode(period_s: float, data: bytes) -> Position | UnusableDatagram | None:
    if data.strip() == _OVERRUN:
        return None
    values = [value for part in data.decode("ascii", "replace").split() if (value := number(part)) is not None]
    if len(values) != _FIELDS or len(data.split()) != _FIELDS:
        detail = f"line {data[:80]!r} is not a sample of rig.hal; load the rig.hal that rig init wrote"
        return UnusableDatagram(FaultKind.GARBLED, detail)
    count, *joints, homed, signal, lost = values
    if not homed:
        detail = "the joints are not homed, so their positions are unknown; home all joints"
        return UnusableDatagram(FaultKind.DEVICE_ERROR, detail)
    period = round(count + lost)
    return Position(joints, period * period_s, period, (plausible(signal),))


class _Sampler(SteadyDevice):
    IS_STREAM = True

    def __init__(self, feedback: LinuxCNC, read: Read) -> None:
        super().__init__(read, 1e3 / feedback.servo_period_ms)

    def _message(self, instant_ns: int) -> bytes:
        *joints, signal = self._read(instant_ns)
        angles = " ".join(f"{angle:.6f}" for angle in joints)
        return f"{self.sent} {angles} 1 {signal:.6f} 0 \n".encode()
