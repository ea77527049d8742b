from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

from analysis import calibrate, diagnose, evaluate, read_table
from analysis.procedures.checks.check_runs import findings_of
from analysis.runs.tables import CircleTable, PoseTable, columns_of
from analysis.runs.written_files import write_csv
from rigs.effects import Backlash
from tests.analysis.procedures.checks.test_lost_poses import table
from tests.support.command_line import ran
from tests.support.diagnosis_cells import RIG, circles, found_in, poses
from tests.support.refusals import refused

PLAY = Backlash(axis=1, width_deg=0.02)


def uncoupled(path: Path) -> Path:
    """Poses of a UR10 whose joint 3 counts from the horizontal."""
    sound = table(60)
    q = sound.q.copy()
    q[:, 2] -= q[:, 1]
    with path.open("wb") as file:
        write_csv(columns_of(PoseTable(q, sound.xyz_mm, None)), file)
    return path


def test_missing_coupling_is_reported_at_import_and_evaluation(tmp_path):
    source, run = uncoupled(tmp_path / "poses.csv"), tmp_path / "run"
    done = ran("import", source, "--rig", "ur10", "--test", "pose", "-o", run)
    said = "(error 0.1"
    assert done.returncode == 0 and said in done.stderr
    assert said in " ".join(ran("analyse", run, COLUMNS="1000").stdout.split())
    measured = read_table(source, "ur10", "pose")
    assert any(said in doubt for doubt in evaluate(measured).doubts)
    for judge in (diagnose, calibrate):
        with refused("run.convention"):
            judge([measured])


def test_one_misfit_of_several_runs_is_ignored_with_one_reason(tmp_path):
    """One table with a missing coupling stopped the diagnosis of all tables of its placement."""
    with (tmp_path / "sound.csv").open("wb") as file:
        write_csv(columns_of(table(60)), file)
    runs = [tmp_path / "runs" / name for name in ("bad", "sound")]
    for source, run in zip((uncoupled(tmp_path / "bad.csv"), tmp_path / "sound.csv"), runs, strict=True):
        assert ran("import", source, "--rig", "ur10", "--test", "pose", "-o", run).returncode == 0
    done = ran("diagnose", *runs)
    said = " ".join((done.stdout + done.stderr).split())
    assert done.returncode == 0 and said.count("only with J3 + J2") == 1
    assert "bad is " in said and "error" not in done.stderr


def test_rig_check_reports_checks_and_findings(tmp_path):
    run = tmp_path / "run"
    assert ran("import", uncoupled(tmp_path / "t.csv"), "--rig", "ur10", "--test", "pose", "-o", run).returncode == 0
    done = ran("check", run)
    assert done.returncode == 3
    lines = done.stdout.splitlines()
    assert any(line.startswith("joints:") and "only with J3 + J2" in line for line in lines)
    assert any(line.startswith("units:") and "no problem" in line for line in lines)
    assert any(line.startswith("gauge sign:") and "cannot be " in line for line in lines)
    found = json.loads(ran("check", run, "--json").stdout)
    (joints,) = (one for one in found["conventions"] if one["name"] == "joints")
    (finding,) = joints["findings"]
    assert finding["meant"].startswith("J3 + J2 ") and finding["misfit"]["as_meant_mm"] < 0.2
    assert finding["misfit"]["as_labelled_mm"] > 100 and finding["strength"] == "decisive"


def test_rig_check_of_a_sound_run_ends_well(tmp_path):
    with (tmp_path / "t.csv").open("wb") as file:
        write_csv(columns_of(table(60)), file)
    run = tmp_path / "run"
    assert ran("import", tmp_path / "t.csv", "--rig", "ur10", "--test", "pose", "-o", run).returncode == 0
    assert ran("check", run).returncode == 0
    assert ran("check", "ur10").returncode == 0
    assert ran("check", "ur10", run).returncode == 2


def test_inverted_gauges_are_refused_if_a_play_would_lead():
    runs = circles((PLAY,), seed=3)
    negated = [replace(run, table=replace(run.table, g_mm=-run.table.g_mm)) for run in runs]
    with refused("run.convention"):
        found_in(negated)


def test_gauges_that_contradict_the_effects_of_the_rig_file_are_refused():
    rig = RIG.model_copy(update={"effects": (PLAY,)})
    run = circles((PLAY,), seed=3, count=1)[0]
    run = replace(run, rig=rig)
    assert isinstance(run.table, CircleTable)
    negated = replace(run, table=replace(run.table, g_mm=-run.table.g_mm))
    with refused("run.convention"):
        found_in([negated], rig)
    assert findings_of([run]) == []


def test_computed_poses_are_left_out_of_a_diagnosis():
    sound, other = poses(3), poses(4)
    wrong = replace(
        other,
        path=Path("wrong"),
        run=replace(other.run, manifest=other.run.manifest.model_copy(update={"name": "wrong"})),
        table=replace(other.table, q=other.table.q[:, [0, 2, 1, 3, 4, 5]]),
    )
    found = found_in([sound, wrong])
    assert found.doubts[0].startswith("wrong is ")
    assert found.accuracy.now_um < 100
