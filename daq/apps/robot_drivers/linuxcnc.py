"""Lines of LinuxCNC's `halsampler -t`, one for each period of the servo thread.

`rig init --robot linuxcnc://HOST` writes the HAL lines and the program that serves them,
`daq/apps/commission/rigfeed.py`. A line contains, separated by blanks: the sample number, the positions of joints 0 to
5 in degrees (`joint.N.pos-fb`), whether all joints are homed, `motion.analog-out-00` and the number of samples lost so
far.

The clock is the number of servo periods. The manual page of halsampler states that gaps in the sample number show the
lost samples. In 2.9.0 the sampler numbers only the samples that it stores, so a full buffer would delay the clock
unseen. The line therefore contains the pin `overruns`, and the period is the sum of both.

Before homing the positions have no reference, so these samples are faults. The host sends nothing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from daq.feedback import Read
from daq.protocol.conversation import NO_TIME, Device, Fault, FaultKind, Host, Sample
from daq.protocol.framing import DelimitedLines, Message
from daq.protocol.numerals import are_angles, number, plausible
from daq.protocol.positions import Order, SteadyDevice
from daq.protocol.streamed import Reaction, Streamed
from rigs.schema.feedback import LinuxCNC

_FIELDS = 10
_OVERRUN = b"overrun"
"""Line by which halsampler marks a gap; the numbers state its size."""


def host(feedback: LinuxCNC) -> Host:
    """Host side of the protocol, which reads the joint angles in degrees."""
    return Streamed(_Samples(feedback), feedback.timeout_s)


def device(feedback: LinuxCNC, read: Read) -> Device:
    """Emulated controller, the device side of the protocol. `read` gives joint angles in degrees."""
    return _Sampler(feedback, read)


class _Samples:
    check = "check that LinuxCNC runs and loads rig.hal"

    def __init__(self, feedback: LinuxCNC) -> None:
        self.frames = DelimitedLines(b"\n")
        self._period_s = feedback.servo_period_ms / 1e3
        self._order = Order()

    def start(self) -> bytes:
        return b""

    def silent(self) -> Reaction:
        return Reaction()

    def read(self, message: Message | Fault) -> Reaction:
        if isinstance(message, Fault):
            return Reaction((message,))
        if message.data.strip() == _OVERRUN:
            return Reaction()
        at_ns = message.last_byte_ns
        values = [number(part) for part in message.data.decode("ascii", "replace").split()]
        if len(values) != _FIELDS or None in values:
            detail = f"line {message.data[:80]!r} is not a sample of rig.hal; load the rig.hal that rig init wrote"
            return Reaction((Fault(FaultKind.GARBLED, at_ns, detail),))
        count, *joints, homed, signal, lost = (math.nan if value is None else value for value in values)
        if not homed:
            detail = "the joints are not homed, so their positions are unknown; home all joints"
            return Reaction((Fault(FaultKind.DEVICE_ERROR, at_ns, detail),))
        if not are_angles(joints):
            return Reaction((Fault(FaultKind.GARBLED, at_ns, f"impossible joint angles {joints}; ignored"),))
        period = round(count + lost)
        stamps = (NO_TIME, message.first_byte_ns, at_ns)
        sample = Sample((*joints, plausible(signal)), *stamps, message.size, period * self._period_s)
        return Reaction(self._order.admit(sample, period))


class _Sampler(SteadyDevice):
    """Emulated controller with homed joints."""

    IS_STREAM = True

    def __init__(self, feedback: LinuxCNC, read: Read) -> None:
        super().__init__(read, 1e3 / feedback.servo_period_ms)

    def _message(self, instant_ns: int) -> bytes:
        *joints, signal = self._read(instant_ns)
        return _line(self.sent, joints, signal)


def _line(count: int, joints: Sequence[float], signal: float) -> bytes:
    angles = " ".join(f"{angle:.6f}" for angle in joints)
    return f"{count} {angles} 1 {signal:.6f} 0 \n".encode()
