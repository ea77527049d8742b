"""Joint angles in Modbus registers, read over TCP at up to `rate_hz`.

The registers contain no clock: the time is that of the answer, with the accuracy of the network.
"""

from __future__ import annotations

import math

from daq.feedback import Read
from daq.protocol.conversation import Device, Fault, FaultKind, Host, Sample
from daq.protocol.framing import Message
from daq.protocol.modbus import Wire, fits, pack, unpack
from daq.protocol.numerals import are_angles
from daq.protocol.polled import Polled
from daq.protocol.registers import RegisterDevice, RegisterDialect, Registers, pack_verdict, verdict
from rigs.schema.feedback import ModbusJoints

_DEG_PER_UNIT = {"deg": 1.0, "rad": math.degrees(1)}


def host(feedback: ModbusJoints) -> Host:
    def reading(registers: Registers, message: Message, requested_ns: int) -> Sample | Fault:
        code = verdict(registers, feedback.status, feedback, message)
        if isinstance(code, Fault):
            return code
        read = [unpack(registers, joint, feedback) * joint.scale + joint.offset for joint in feedback.joints]
        angles_deg = tuple(value * _DEG_PER_UNIT[feedback.units] for value in read)
        if not are_angles(angles_deg):
            detail = f"angles {angles_deg}; ignored; check `joints`, `word_order` and `byte_order`"
            return message.fault(FaultKind.GARBLED, detail)
        return message.sample(angles_deg, requested_ns=requested_ns, status=code)

    wire = Wire(feedback.port, feedback.framing, serving=False)
    return Polled(RegisterDialect(feedback, reading, wire), feedback.timeout_s, feedback.rate_hz)


def device(feedback: ModbusJoints, read: Read) -> Device:
    def read_registers(now_ns: int) -> list[int] | None:
        registers = [0] * feedback.count
        for joint, angle_deg in zip(feedback.joints, read(now_ns), strict=True):
            raw = (angle_deg / _DEG_PER_UNIT[feedback.units] - joint.offset) / joint.scale
            if not fits(raw, joint):
                return None
            pack(registers, joint, feedback, raw)
        pack_verdict(registers, feedback.status, feedback, good=True)
        return registers

    return RegisterDevice([(feedback, read_registers)])
