"""A yaw lap in simulated time, read by gauges with an internal cycle and stored like a recording of rigd."""

from __future__ import annotations

import random
from pathlib import Path

import numpy as np
import yaml

from analysis.apps.emulate.robot import Trace, trace
from daq import feedback, gauges
from daq.acquisition.streams import streams_of
from daq.apps.emulate.timed import Unsteady, timed_device, timed_read
from daq.protocol.conversation import Sample
from daq.store import RunWriter, new_manifest
from rigs.load import load, parse
from rigs.rig import Rig
from tests.support.stamped import S
from tests.support.virtual_line import Wire, run

_BEGIN_S = 1.0
HARSH = Unsteady(ppm=500.0, jitter=0.05, missed=0.005)


def lap_rig(cycle_ms: float, mode: str = "polled") -> tuple[Rig, str]:
    """Rig of a UR10e with two Sylvac cables of this cycle time, and its text."""
    data = yaml.safe_load(load("ur10e")[1])
    for name, offset_mm in (("g1", 25), ("g2", -25)):
        data["gauges"][name] = {
            "interface": "sylvac_opto_rs",
            "mode": mode,
            "port": f"/dev/ttyUSB{name[1]}",
            "offset_mm": offset_mm,
            "timing": {"latch": "own_cycle", "cycle_ms": cycle_ms},
        }
    data["tests"]["circle"]["eccentricity_mm"] = [0.5, 0.3, 0.0]
    text = yaml.safe_dump(data)
    return parse(text, "cycling"), text


def drive(rig: Rig) -> Trace:
    """Simulate the lap without noise."""
    return trace(rig, "acw")


def record(runs: Path, rig: Rig, rig_text: str, driven: Trace, wires: dict[str, Wire], seed: int) -> Path:
    """Record a run of the lap. rig_text: text stored in the run; wires: lines of g1, g2 and the robot."""
    until_ns = round((driven.t_s[-1] + 2 * _BEGIN_S) * S)
    noise = np.random.default_rng(seed)
    columns = {stream.name: stream.columns for stream in streams_of(rig)}
    writer = RunWriter.create(
        runs,
        new_manifest(
            name="lap", test="yaw", direction="acw", rig_name=rig.name, rig_text=rig_text, operator="", streams=columns
        ),
    )

    # np.interp copies non-contiguous columns at each of the many thousand times.
    joints_deg, gauges_mm = np.degrees(driven.q).T.copy(), driven.g_mm.T.copy()

    def joints(now_ns: int) -> list[float]:
        return [float(np.interp(now_ns / S - _BEGIN_S, driven.t_s, joint)) for joint in joints_deg]

    for place, (name, gauge) in enumerate(rig.gauges):

        def reading(now_ns: int, place: int = place) -> list[float]:
            at = np.interp(now_ns / S - _BEGIN_S, driven.t_s, gauges_mm[place])
            return [float(at + noise.normal(0.0, 5e-4))]

        chance = random.Random(f"{name} {seed}")
        device = gauges.device([gauge], timed_read(reading, gauge.timing, HARSH, chance))
        device = timed_device(device, gauge.timing, HARSH, chance)
        items = run(gauges.host([gauge]), device, wires[name], until_ns)
        writer.append(name, [item for item in items if isinstance(item, Sample)])
    items = run(feedback.host(rig.feedback), feedback.device(rig.feedback, joints), wires["robot"], until_ns)
    writer.append("robot", [item for item in items if isinstance(item, Sample)])
    writer.close("complete", "told to", {})
    return writer.path
