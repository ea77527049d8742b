"""Crash states of recordings on a disk that forgets what was not synced."""

from random import Random

import pytest

from tests.support.powercut import IoWorker, Link, Sync, Write, survivors
from tests.support.powercut_trial import recording, trial


@pytest.mark.parametrize("seed", [0, 1, 2, 3])
def test_synced_rows_survive_a_power_cut(tmp_path, seed):
    (tmp_path / "recording").mkdir()
    recorded = recording(tmp_path / "recording", seed)
    real, logged = IoWorker.read(tmp_path / "recording"), survivors(recorded.before, recorded.log, None)
    assert logged.tree() == real.tree()  # the store changed a file beside daq.store.durable
    kinds = {trial(recorded, tmp_path / str(state), 100 * seed + state) for state in range(15)}
    assert "brought back" in kinds


def test_simulated_disk_forgets_only_unsynced_data():
    log = [Link(0, "a", 1, False), Write(1, 0, b"x" * 9000), Sync(1), Sync(0), Write(1, 9000, b"y" * 9000)]
    log += [Link(0, "b", 2, False), Write(2, 0, b"z"), Sync(2)]
    states = [survivors(IoWorker(), log, Random(seed)).tree() for seed in range(200)]
    assert all(state["a"][:9000] == b"x" * 9000 for state in states)
    assert all(state.get("b", b"z") == b"z" for state in states)
    assert {"b" in state for state in states} == {True, False}
    tails = {state["a"][9000:] for state in states}
    assert {b"", b"y" * 9000, bytes(9000)} <= tails and len(tails) > 20
