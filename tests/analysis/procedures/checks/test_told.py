import json
from dataclasses import replace
from pathlib import Path

from analysis import calibrate, diagnose, evaluate, read_table
from analysis.procedures.checks.check_runs import findings_of
from analysis.runs.tables import PoseTable, columns_of
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


def test_missing_coupling_is_reported_at_import_evaluation_and_check(tmp_path):
    source, run = uncoupled(tmp_path / "poses.csv"), tmp_path / "run"
    done = ran(f"import {source} --rig ur10-cell --test pose -o {run}")
    said = "(error 0.1"
    assert done.returncode == 0 and said in done.stderr
    assert said in " ".join(ran("analyse", run, COLUMNS="1000").stdout.split())
    measured = read_table(source, "ur10", "pose")
    assert any(said in doubt for doubt in evaluate(measured).doubts)
    for judge in (diagnose, calibrate):
        with refused("readings.unsuitable", "order, signs, zeros or coupling of"):
            judge([measured])
    done = ran("check", run)
    assert done.returncode == 3
    lines = done.stdout.splitlines()
    assert any(line.startswith("joints:") and "only with J3 + J2" in line for line in lines)
    assert any(line.startswith("units:") and "no problem" in line for line in lines)
    assert any(line.startswith("gauge sign:") and "cannot be " in line for line in lines)
    found = json.loads(ran(f"check {run} --json").stdout)
    (joints,) = (one for one in found["conventions"] if one["name"] == "joints")
    (finding,) = joints["findings"]
    assert finding["meant"].startswith("J3 + J2 ") and finding["misfit"]["as_meant_mm"] < 0.2
    assert finding["misfit"]["as_labelled_mm"] > 100 and finding["strength"] == "decisive"


def test_gauges_that_contradict_the_effects_of_the_rig_file_are_refused():
    rig = RIG.model_copy(update={"effects": (PLAY,)})
    run = circles((PLAY,), seed=3, count=1)[0]
    run = replace(run, rig=rig)
    negated = replace(run, table=replace(run.table, g_mm=-run.table.g_mm))
    with refused("readings.unsuitable", "gauges count in the opposite direction"):
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
