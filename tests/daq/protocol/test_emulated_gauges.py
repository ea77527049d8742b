"""Every serial gauge in an emulated cell: the rig file names it, the cell makes it, the daemon's stream reads it.

In simulated time, at the pace of its own line.
"""

import math
from itertools import pairwise
from typing import Any

import pytest
import yaml

from daq.acquisition.stream_buffer import samples_of
from daq.acquisition.streams import streams_of
from daq.emulators.instruments import gauge_device
from rigs.load import SHIPPED, parse
from tests.support.drivers import LINE, NEEDED, gauge
from tests.support.refusals import refused
from tests.support.simulated_conversation import S, simulate

INTERFACES = sorted(set(NEEDED) - {"modbus_map"})
SHARED = [name for name in INTERFACES if gauge(name).shares]


class Swinging:
    """Two gauges that swing by 0.8 mm, in opposite directions, twice a second."""

    def gauge_mm(self, name: str, now_ns: int) -> float:
        return (1 if name == "g1" else -1) * 0.8 * math.sin(4 * math.pi * now_ns / S)

    def joints_deg(self, now_ns: int) -> list[float]:
        return [0.0] * 6


def _rig_text(interface: str, *, shared: bool) -> str:
    data = yaml.safe_load((SHIPPED / "ur10e-cell.yaml").read_text())
    probe = {"interface": interface, **NEEDED[interface]}
    if interface == "micro_epsilon_ild1420":
        probe["zero_mm"] = 5.0
    data["gauges"] = {
        "g1": probe | {"port": "/dev/ttyUSB0", "offset_mm": 25},
        "g2": probe | {"port": "/dev/ttyUSB0" if shared else "/dev/ttyUSB1", "offset_mm": -25},
    }
    if shared:
        data["gauges"]["g2"]["channel"] = 2
    return yaml.safe_dump(data)


@pytest.mark.parametrize("interface", INTERFACES)
def test_gauges_share_a_port_only_if_one_answer_contains_both(interface):
    text = _rig_text(interface, shared=True)
    if gauge(interface).bus:
        with refused("rig_file.invalid", "use different values"):
            parse(text, "cell")
        return
    if interface in SHARED:
        assert parse(text, "cell").gauges.g2 is not None
        return
    with refused("rig_file.invalid", "supports a single gauge per port,"):
        parse(text, "cell")


@pytest.mark.parametrize("interface", [name for name in INTERFACES if "line" in NEEDED[name]])
def test_unknown_line_settings_must_be_given(interface):
    data: dict[str, Any] = yaml.safe_load(_rig_text(interface, shared=False))
    del data["gauges"]["g1"]["line"]
    assert LINE["line"] == data["gauges"]["g2"]["line"]
    with refused("rig_file.invalid"):
        parse(yaml.safe_dump(data), "cell")


def test_emulated_gauge_follows_the_timing_of_the_rig_file():
    data = yaml.safe_load(_rig_text("tesa_tt", shared=False))
    for probe in data["gauges"].values():
        probe["timing"] = {"latch": "own_cycle", "cycle_ms": 200, "answer_delay_ms": 30}
    rig = parse(yaml.safe_dump(data), "cell")
    stream = streams_of(rig)[0]
    items = simulate(
        stream.host(), gauge_device(rig, Swinging(), ["g1"])(), 4 * S, character_ns=stream.line.character_ns
    )
    samples = samples_of(items)
    assert min(sample.first_byte_ns - sample.requested_ns for sample in samples) > 0.03 * S
    changed = [b for a, b in pairwise(samples) if a.values != b.values]
    assert len(changed) == pytest.approx((samples[-1].requested_ns - samples[0].requested_ns) / (0.2 * S), abs=2)
