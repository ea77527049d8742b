from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from analysis.apps.plant import store
from analysis.apps.plant.before_after import differences, headlines
from analysis.apps.plant.records import RunRecord, fingerprint_of, record_of
from analysis.procedures.shared.quantity import Quantity
from daq.store.manifest import Manifest, load_manifest
from rigs.errors import FileError
from tests.support.dated_runs import dated_run
from tests.support.refusals import refused


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Three runs with a play, three without."""
    directory = tmp_path_factory.mktemp("runs")
    return [dated_run(directory, day, 0.02 if day < 3 else 0.004) for day in range(6)]


def test_change_by_a_repair_exceeds_the_spread(runs):
    found = {one.figure: one for one in differences(runs[3:], runs[:3])}
    play = found["play_j3_deg"]
    assert play.is_larger and play.difference.value == pytest.approx(-0.016, abs=0.002)
    assert play.before == pytest.approx(0.02, abs=0.002) and (play.runs_before, play.runs_after) == (3, 3)
    assert "axis 3" in play.sentence and "fell" in play.sentence
    assert "spread" in play.sentence and play.is_larger
    assert not found["play_j2_deg"].is_larger and ": within the " in found["play_j2_deg"].sentence


def test_one_run_a_side_has_no_spread_and_no_verdict(runs):
    found = differences(runs[3:4], runs[:1])
    for one in found:
        assert not one.is_larger and not np.isfinite(one.difference.u)
        assert one.to_dict()["difference"]["u"] is None
    (line,) = headlines(found)
    assert "unknown" in line
    several = headlines(differences(runs[1:3], [runs[0]]))
    assert len(several) == 1 and "within" in several[0]
    assert "known" not in " ".join(headlines(differences(runs[3:], runs[:3])))


def test_history_of_other_runs_supplies_the_spread(tmp_path):
    before, after = dated_run(tmp_path, 0, 0.01), dated_run(tmp_path, 20, 0.02)
    one = record_of(before, load_manifest(before), fingerprint_of(before))
    rng = np.random.default_rng(1)
    others = [replace(one, name=f"earlier-{k}", fingerprint=str(k), figures=scattered(one, rng)) for k in range(30)]
    store.prepare(tmp_path / store.FILE)
    store.save(tmp_path / store.FILE, [(other.name, "", other, "") for other in others])
    found = {one.figure: one for one in differences([after], [before])}
    assert found["play_j3_deg"].is_larger and np.isfinite(found["band_deg"].difference.u)


def scattered(record: RunRecord, rng: np.random.Generator) -> dict[str, Quantity]:
    """The figures of a record with a scatter of 0.0005 in each."""
    return {
        name: replace(one, value=one.value + 0.0005 * rng.standard_normal()) for name, one in record.figures.items()
    }


def test_two_programs_of_a_test_have_different_titles(runs, monkeypatch):
    """Every second run counts as one of another program."""

    def recorded(path: Path, manifest: Manifest, fingerprint: str) -> RunRecord:
        return replace(record_of(path, manifest, fingerprint), program="01"[runs.index(path) % 2])

    monkeypatch.setattr("analysis.apps.plant.before_after.record_of", recorded)
    found = differences(runs[3:5], runs[:2])
    assert {one.title for one in found} == {"yaw acw, program 0", "yaw acw, program 1"}
    assert len({one.sentence for one in found}) == len(found)


def test_runs_that_cannot_be_compared_are_refused(runs, tmp_path):
    with refused("run.copied", "after here, before there"):
        differences(runs[:2], runs[1:])
    with refused("runs.not_comparable", "no combination of test, direction, placement"):
        differences([dated_run(tmp_path, 0, 0.01, "cw")], runs[:1])
    with pytest.raises(FileError):
        differences([tmp_path / "nowhere"], runs[:1])
