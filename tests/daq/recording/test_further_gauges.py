import json
from typing import Any

import pytest
import yaml
from mcap.reader import make_reader

from analysis.runs.loading import load_measured
from daq.store import read_run
from rigs.load import parse
from rigs.problems import RigFileError
from tests.support.bench import rig_text
from tests.support.simulated_bench import SimulatedBench

HEADS = {"interface": "keyence_dl_rs1a", "port": "/dev/ttyUSB9", "line": "57600 8N1", "offset_mm": 0}


def text(**further: dict[str, Any]) -> str:
    data = yaml.safe_load(rig_text())
    data["gauges"] |= further
    return yaml.safe_dump(data)


def test_tests_measure_with_two_and_all_are_recorded():
    gauges = parse(text(g3=HEADS, g5=HEADS | {"channel": 2}), "bench").gauges
    assert [name for name, _ in gauges] == ["g1", "g2"]
    assert list(gauges.recorded) == ["g1", "g2", "g3", "g5"] and gauges.baseline_mm == 50


@pytest.mark.parametrize(
    ("further", "told"),
    [
        ({"g3": HEADS, "g4": HEADS}, "g3 and g4 share /dev/ttyUSB9 and channel 1"),
        (
            {"g3": HEADS, "g4": HEADS | {"channel": 2, "units": "inch"}},
            "g3 and g4 share",
        ),
        ({"g4": HEADS | {"interface": "tesa_tt", "line": "4800 7E2"}} | {"g3": HEADS}, "g3 and g4 share"),
        ({"g9": HEADS}, "unknown key"),
    ],
)
def test_further_gauges_follow_the_rules_of_the_first_two(further, told):
    with pytest.raises(RigFileError) as refused:
        parse(text(**further), "bench")
    assert told in str(refused.value)


def test_four_gauges_are_recorded_exported_and_shown(tmp_path):
    with SimulatedBench(tmp_path, text(g3=HEADS, g4=HEADS | {"channel": 2})) as bench:
        bench.motion.mm |= {"g3": 0.3, "g4": -0.4}
        bench.start().all_reading()
        path = bench.record()
        bench.recorded(30)
        shown = bench.run("status").stdout
        assert "0.3000 mm" in shown and "-0.4000 mm" in shown
        bench.stop()
    assert bench.run("export", path, "--to", "mcap", "-o", "run.mcap").returncode == 0
    heads = read_run(path).streams["g3_g4"]
    assert len(heads["g3_mm"]) > 3
    assert heads["g3_mm"] == pytest.approx(0.3) and heads["g4_mm"] == pytest.approx(-0.4)
    with (tmp_path / "run.mcap").open("rb") as file:
        exported = [json.loads(found[2].data) for found in make_reader(file).iter_messages(topics=["/g3_g4"])]
    assert {row["g3_mm"] for row in exported} == {0.3}
    assert load_measured(path).table.g_mm.shape[1] == 2
