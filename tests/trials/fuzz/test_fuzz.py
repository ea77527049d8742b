"""`scripts/dev fuzz` in small: a fixed sample of mutated inputs to every target, and failures that are seen."""

import json

import pytest

# private _Continuous, _label: what stands behind a gauge's messages and a request, the innermost that inputs reach
from daq.service.control import reply
from daq.service.daemon import _label
from tests.trials.fuzz.fuzzing import Block, is_file, run_block, targets

SAMPLE = {"rig_files": 12, "runs": 20, "tables": 60, "chunk_values": 30}


@pytest.mark.parametrize("target", targets())
def test_a_sample_of_mutated_inputs_does_no_harm(target):
    inputs = SAMPLE[target] if is_file(target) else 800
    outcome = run_block(Block(target, 5, 0, inputs))
    assert outcome.failure == "" and outcome.inputs >= inputs


@pytest.mark.parametrize("key", ["k" * 5000, "a\nb", "\ud800"])
def test_a_request_with_an_odd_key_gets_a_short_line(key):
    asked = {"command": "record_start", "name": "x", "test": "radial", key: "v" * 5000}
    answer = reply(json.dumps(asked).encode(), lambda request: {"run": _label(request).name})
    assert answer["what"].isprintable() and len(answer["what"]) < 300
