"""`rig moved` on an independent world: causes, sizes, indistinguishable causes, and steps within runs."""

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from analysis import load_run
from analysis.api import diagnose
from analysis.apps.commission.movement_report import what_to_do
from analysis.apps.commission.next_touch import candidates_of, hidden_causes, next_posture
from analysis.apps.commission.what_moved import moved_of, what_moved
from analysis.apps.report.diagnosis_words import movement_sentence
from analysis.apps.report.summary_words import summarise
from analysis.apps.report.texts import keys_of, texts_of
from analysis.movement.between import without_moved
from analysis.movement.evidence import condition
from analysis.movement.inference import compare, study
from analysis.movement.step_search import find_step
from rigs.errors import FileError
from tests.support.command_line import ran
from tests.support.moved_cell import Case, label, observed, write_touches
from tests.worlds import moved as world

SCATTER_MM = 0.05


@cache
def case(cause: str, seed: int = 2) -> Case:
    return Case(world.SIX, cause, SCATTER_MM, seed)


@pytest.mark.parametrize("cause", ["nothing", "base", "tool", "zero 1", "zero 3"])
def test_eight_touches_name_the_cause(cause):
    drawn = case(cause)
    assert label(drawn.named(drawn.touch_again(8))) == cause


def test_size_direction_and_uncertainty_are_those_of_the_world():
    drawn = case("tool")
    found = moved_of(drawn.reference, compare(drawn.reference, observed(drawn.model, *drawn.touch_again(12)))).named
    assert found.translation_mm is not None and found.u is not None
    assert np.linalg.norm(np.subtract(found.translation_mm, drawn.change.tool)) < 5 * found.u
    assert 0.005 < found.u < 0.1


def test_a_pair_is_named_if_no_single_cause_fits():
    drawn = case("tool+zero 2")
    assert label(drawn.named(drawn.touch_again(10))) == "tool+zero 2"


def test_one_unseated_ball_is_no_movement():
    drawn = case("nothing")
    sockets, q = drawn.touch_again(8)
    q[3, 2] += np.radians(0.3)  # some millimetres
    compared = compare(drawn.reference, observed(drawn.model, sockets, q))
    assert compared.identified_cause is None or compared.identified_cause.what in ("nothing", "other")


def test_one_socket_and_the_base_are_not_separated():
    drawn = case("base")
    rows = [k for k, name in enumerate(drawn.sockets) if name == "A"]
    reference = observed(drawn.model, ["A"] * len(rows), _touched(drawn, rows, world.no_change(6), drawn.arm))
    new = observed(drawn.model, ["A"] * 4, _touched(drawn, rows[:4], drawn.change, drawn.after))
    found = what_moved(study(reference), new)
    assert found.named is None or found.named.what in ("base", "socket")
    if found.named is None:
        assert {cause.what for cause in found.cannot_separate} >= {"base", "socket"}


def _touched(drawn: Case, rows: list[int], change: world.Change, arm: world.TrueArm) -> np.ndarray:
    return world.touched(arm, drawn.q[rows], ["A"] * len(rows), change, SCATTER_MM, np.random.default_rng(5))


def test_ball_near_the_last_axis_names_the_separating_test():
    drawn = Case(world.SIX, "nothing", 0.3, 4)
    found = moved_of(drawn.reference, None, plan=True)
    axes = {lever.cause.axis for lever in found.hidden}
    assert 6 in axes and not axes & {1, 2, 3}
    assert hidden_causes(drawn.reference, candidates_of(drawn.reference))[0].scatter_mm > 0.1


def test_plan_names_reference_postures_until_a_cause_is_named():
    drawn = case("zero 3")
    candidates = candidates_of(drawn.reference)
    posture = next_posture(drawn.reference, candidates, None)
    assert posture is not None and np.abs(drawn.q - posture.angles).max(axis=1).min() < 0.01
    compared = compare(drawn.reference, observed(drawn.model, *drawn.touch_again(8)))
    found = moved_of(drawn.reference, compared, plan=True)
    assert found.named is not None and found.next_posture is None
    assert what_to_do(found).startswith("Re-master axis 3")


def test_scatter_of_the_reference_is_found():
    small, large = (Case(world.SIX, "nothing", mm, 7).reference.scatter_mm for mm in (0.02, 0.2))
    assert 0.01 < small < 0.06 and 0.1 < large < 0.35


def test_step_within_a_run_is_found_at_its_row():
    drawn = case("zero 2")
    new = drawn.touch_again(10)
    reference = drawn.before
    both = observed(drawn.model, drawn.sockets + new[0], np.concatenate([reference, new[1]]))
    order = np.concatenate([run.rows for run in both])
    step = find_step(both, order)
    assert step is not None and label(step.found[0].cause) == "zero 2"
    assert abs(step.first - len(reference)) <= 1
    sound = observed(drawn.model, drawn.sockets, reference)
    assert find_step(sound, np.concatenate([run.rows for run in sound])) is None


def test_readings_of_other_sockets_are_refused():
    drawn = case("nothing")
    sockets, q = drawn.touch_again(6)
    far = q + np.radians([20, 0, 0, 0, 0, 0])
    reference = observed(drawn.model, drawn.sockets, drawn.before)
    with pytest.raises(FileError) as elsewhere:
        what_moved(study(reference), observed(drawn.model, sockets, far))
    with pytest.raises(FileError) as other:
        what_moved(study(reference), observed(drawn.model, ["C"] * 6, q))
    assert elsewhere.value.code == other.value.code == "readings.unsuitable"


def test_evidence_prefers_the_right_scatter():
    conditioned = condition(case("nothing").reference.conditioned.reference)
    assert sum(scenario.weight for scenario in conditioned.scenarios) == pytest.approx(1.0)


def test_zero_moved_between_runs_is_reported_and_the_shorter_run_ignored(tmp_path):
    drawn = case("zero 3")
    _write_runs(tmp_path, drawn, {"before": (drawn.sockets, drawn.before), "after": drawn.touch_again(8)})
    runs = [load_run(tmp_path / "runs" / name) for name in ("before", "after")]
    sound, (movement,), _ = without_moved(runs[0].rig, runs)
    assert [run.run.manifest.name for run in sound] == ["before"]
    said = movement.to_dict()
    assert (said["from"], said["to"], said["what"], said["axis"]) == ("before", "after", "zero", 3)
    assert said["size_deg"] == pytest.approx(np.degrees(drawn.change.zero[2]), abs=5 * said["u_deg"])
    assert movement_sentence(movement, texts_of("de")).startswith("Die Nullstellung von Achse 3")


def _write_runs(to: Path, drawn: Case, tables: dict[str, tuple[list[str], np.ndarray]]) -> None:
    (to / "cell.yaml").write_text(drawn.rig_text, encoding="utf-8")
    for name, (sockets, q) in tables.items():
        write_touches(to, name, sockets, q)


def test_a_diagnosis_of_both_runs_begins_with_the_movement(tmp_path):
    drawn = case("base")
    _write_runs(tmp_path, drawn, {"before": (drawn.sockets, drawn.before), "after": drawn.touch_again(8)})
    summary = summarise(diagnose([tmp_path / "runs/before", tmp_path / "runs/after"]))
    assert keys_of(summary.badge) == ("badge_moved",)
    assert keys_of(summary.headline)[0] == "moved_between" and summary.headline.startswith("The base or the plate ")
    assert "check_act_base_or_plate" in keys_of(summary.next)


def test_command_names_the_moved_part(tmp_path):
    drawn = case("base")
    _write_runs(tmp_path, drawn, {"before": (drawn.sockets, drawn.before), "after": drawn.touch_again(6)})
    page = tmp_path / "moved.html"
    words = ["moved", str(tmp_path / "runs/before"), "--new", str(tmp_path / "runs/after")]
    done = ran(*words, "-o", page)
    assert done.returncode == 0
    assert done.stdout.splitlines()[0].split(".")[0] in page.read_text(encoding="utf-8")
    said = json.loads(ran(*words, "--json").stdout)
    assert said["causes"][0]["what"] == "base" and len(said["causes"][0]["translation_mm"]) == 3
    assert "together" not in said["causes"][0]
    tables = ["moved", str(tmp_path / "before.csv"), "--new", str(tmp_path / "after.csv"), "--json"]
    of_tables = json.loads(ran(*tables, "--rig", tmp_path / "cell.yaml").stdout)
    assert of_tables["causes"] == said["causes"]
    assert ran("moved", tmp_path / "runs/before", "--plan").stdout.count("Next: touch socket") == 1
