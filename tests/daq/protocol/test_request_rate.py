import numpy as np
import pytest

from daq import gauges
from rigs.schema.modbus import ModbusMap

MS = 1_000_000
RATE_HZ = 500.0


def _requested_ns(late_ns: int, stall_at_ns: int = -1, stall_ns: int = 0) -> np.ndarray:
    """When a gauge is asked in two seconds by a computer that is late by this at each turn, and once stands still."""
    fields = {"address": 0, "count": 2, "function": 4, "value": {"address": 0, "type": "float32"}, "rate_hz": RATE_HZ}
    common = {"interface": "modbus_map", "port": "tcp://127.0.0.1:502", "offset_mm": 25, "accuracy_mm": 0.01}
    conversation = gauges.host([ModbusMap.model_validate(common | fields)])
    now_ns, asked_ns = 0, list[int]()
    step = conversation.connected(now_ns)
    while now_ns < 3000 * MS:
        if step.send:
            asked_ns.append(now_ns)
            now_ns += 300_000
            step = conversation.received(step.send[:4] + b"\0\7" + step.send[6:8] + b"\4\0\0\0\0", now_ns)
            continue
        now_ns = max(now_ns, step.wake_ns) + late_ns
        if 0 <= stall_at_ns <= now_ns:
            now_ns, stall_at_ns = now_ns + stall_ns, -1
        step = conversation.tick(now_ns)
    return np.array(asked_ns)


@pytest.mark.parametrize("late_ns", [0, 300_000, 1_000_000])
def test_slightly_late_computer_keeps_the_request_rate(late_ns):
    asked_ns = _requested_ns(late_ns)
    asked_ns = asked_ns[asked_ns >= asked_ns[-1] - 2000 * MS]
    rate_hz = (len(asked_ns) - 1) * 1e9 / np.ptp(asked_ns)
    assert 0.97 * RATE_HZ < rate_hz <= 1.001 * RATE_HZ  # but for the pauses that stir the line


def test_stall_is_not_followed_by_a_burst():
    asked_ns = _requested_ns(0, stall_at_ns=2000 * MS, stall_ns=400 * MS)
    afterwards = asked_ns[asked_ns >= 2400 * MS]
    assert np.diff(afterwards).min() >= 0.9e9 / RATE_HZ
