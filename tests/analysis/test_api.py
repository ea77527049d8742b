import inspect
import json
import subprocess
import sys
import textwrap
from dataclasses import replace

import numpy as np
import pyarrow.csv
import pytest

import analysis
from analysis import (
    CircleCurve,
    FileError,
    PoseCurve,
    RadialCurve,
    RepeatabilityCurve,
    calibrate,
    compare,
    diagnose,
    evaluate,
    evaluate_runs,
    load_run,
    read_table,
    save_run,
    simulate,
)
from analysis.procedures.shared.test_kind import Noise
from analysis.procedures.simulate import simulated_run
from rigs import entry
from rigs.arms import load_arm
from rigs.effects.backlash import Backlash
from rigs.load import load
from tests.support.command_line import ran
from tests.support.handmade_diagnosis import diagnosis
from tests.support.refusals import refused
from tests.support.table_cases import RIG_FILE, csv_text, plain

RIG = "paper-fanuc"
PLAY = [Backlash(effect="backlash", axis=1, width_deg=0.02)]
FUNCTIONS = [value for name in analysis.__all__ if inspect.isfunction(value := getattr(analysis, name))]


@pytest.fixture(scope="module")
def laps():
    """An acw and a cw run of a robot with a play that its rig file does not know."""
    return [simulate(RIG, "yaw", "acw", seed=1, effects=PLAY), simulate(RIG, "yaw", "cw", seed=1, effects=PLAY)]


@pytest.fixture(scope="module")
def results(laps):
    return evaluate_runs(laps)


def test_run_is_evaluated_once_while_its_result_is_held(laps, results):
    assert evaluate(laps[0]) is results[0] and evaluate(laps[1]) is results[1]
    assert evaluate(replace(laps[0])) is not results[0]


def test_the_import_loads_nothing_heavy():
    heavy = "{'numpy', 'scipy', 'pyarrow', 'pydantic', 'matplotlib', 'typer'}"
    code = f"import sys, analysis; print(sorted({heavy} & sys.modules.keys()))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"


def test_a_name_that_is_not_public_is_an_attribute_error():
    with pytest.raises(AttributeError, match="'analyse_runs'"):
        analysis.analyse_runs  # type: ignore[attr-defined]  # noqa: B018 - the access is the test


@pytest.mark.parametrize("function", FUNCTIONS, ids=lambda function: function.__name__)
def test_every_function_documents_arguments_result_and_errors(function):
    told = inspect.getdoc(function) or ""
    missing = [name for name in inspect.signature(function).parameters if f"\n{name}: " not in told]
    assert missing == []
    assert all(word in told for word in ("\n\nReturns ", "\n\nRaises ", "\n\nExample:\n\n", "\n\nSource: "))


@pytest.mark.parametrize(
    "value",
    [
        value
        for name in analysis.__all__
        if "\n\nExample:\n\n" in (inspect.getdoc(value := getattr(analysis, name)) or "")
    ],
    ids=lambda value: value.__name__,
)
def test_every_example_runs(value, tmp_path, monkeypatch, laps):
    """Examples that read a file find a run at its path. `diagnose` takes long and is only compiled."""
    example = (inspect.getdoc(value) or "").split("\n\nExample:\n\n")[1].split("\n\n")[0]
    code = compile(textwrap.dedent(example), "example", "exec")
    monkeypatch.chdir(tmp_path)
    if value is not save_run:
        save_run(laps[0], "runs/monday-acw")
    pyarrow.csv.write_csv(laps[0].to_table(), "roll.csv")
    if value is not diagnose:
        exec(code, {name: getattr(analysis, name) for name in analysis.__all__})  # noqa: S102 - examples of our own


def test_the_curve_of_a_circle_has_the_figures(results):
    curve = results[0].curve
    assert isinstance(curve, CircleCurve)
    assert curve.phi_deg.shape == curve.error_deg.shape == curve.error_u_deg.shape == (720,)
    assert curve.phi_deg.min() >= 0 and curve.phi_deg.max() < 360
    assert [turn.name for turn in results[0].reversals if turn.joint == 1] == ["Theta", "Theta"]
    band = results[0].figures["band_deg"]
    # The figure is lowered by what noise adds to a range.
    assert np.ptp(curve.error_deg) == pytest.approx(band.value, abs=10 * band.u)
    assert curve.to_table().column_names == ["phi_deg", "angle_deg", "error_deg", "error_u_deg", "deviation_mm"]


def test_u_of_the_error_follows_the_noise_within_a_run():
    rig, text = load(RIG)
    still = Noise(scatter_deg=0.0, scatter_mm=0.0)
    exact, noisy = (
        evaluate(simulated_run(rig, text, "yaw", "acw", seed, PLAY, still)).curve.to_table() for seed in (None, 3)
    )
    off = (noisy["error_deg"].to_numpy() - exact["error_deg"].to_numpy()) / noisy["error_u_deg"].to_numpy()
    assert 0.5 < np.sqrt(np.mean(off**2)) < 1.5


def test_the_points_of_radial_and_repeatability_runs():
    radial, repeatability = (evaluate(simulate(RIG, test)) for test in ("radial", "repeatability"))
    assert isinstance(radial.curve, RadialCurve) and isinstance(repeatability.curve, RepeatabilityCurve)
    used = radial.curve.deviation_mm[radial.curve.used]
    assert np.ptp(used) == pytest.approx(radial.figures["band_mm"].value, abs=10 * radial.figures["band_mm"].u)
    assert radial.curve.to_table().num_rows == len(radial.curve.target)
    readings = repeatability.curve.to_table().to_pylist()
    assert {one["approach"] for one in readings} == {"out", "in"} and {one["visit"] for one in readings} >= {1, 2}
    assert repeatability.reversals == ()


def test_poses_of_a_table_from_elsewhere(tmp_path):
    (tmp_path / "poses.csv").write_text(csv_text(plain("pose")))
    result = evaluate(read_table(tmp_path / "poses.csv", RIG_FILE, "pose"))
    assert isinstance(result.curve, PoseCurve)
    table = result.curve.to_table()
    assert table.column_names[:5] == ["row", "x_mm", "y_mm", "z_mm", "distance_mm"]
    size = np.sqrt(sum(np.square(table[f"{axis}_mm"].to_numpy()) for axis in "xyz"))
    assert table["distance_mm"].to_numpy() == pytest.approx(size)


def test_simulation_is_reproducible_with_other_noise_per_direction(laps):
    again = simulate(RIG, "yaw", "acw", seed=1, effects=PLAY)
    assert again.to_table().equals(laps[0].to_table())
    noise = []
    for run in laps:
        exact = simulate(RIG, "yaw", run.run.manifest.direction, seed=None, effects=PLAY)
        noise.append(run.to_table()["g1_mm"].to_numpy() - exact.to_table()["g1_mm"].to_numpy())
    rows = min(map(len, noise))
    assert abs(np.corrcoef(noise[0][:rows], noise[1][:rows])[0, 1]) < 0.5


def test_saved_run_is_loaded_unchanged_and_never_overwritten(laps, tmp_path):
    path = save_run(laps[0], tmp_path / "monday")
    loaded = load_run(path)
    assert loaded.run.manifest.name == "monday"
    assert loaded.to_table().equals(laps[0].to_table())
    assert evaluate(loaded).figures == evaluate(laps[0]).figures
    with pytest.raises(FileError, match="exists already"):
        save_run(laps[0], path)


def test_command_prints_the_results_of_the_functions(laps, tmp_path):
    paths = [str(save_run(run, tmp_path / run.path)) for run in laps]
    done = ran("analyse", *paths, "--json")
    runs = [load_run(path) for path in paths]
    assert json.loads(done.stdout)["runs"] == [one.to_dict() for one in evaluate_runs(runs)]
    done = ran("compare", *paths, "--json")
    assert json.loads(done.stdout) == compare(runs).to_dict()


def test_a_comparison_has_curves_and_residuals_of_every_reading(laps):
    found = compare(laps)
    one = found.runs[0]
    assert one.residuals_mm.shape == (len(one.rows), 2)
    assert one.rows.min() > 0 and one.rows.max() < laps[0].to_table().num_rows - 1  # without lead-in and lead-out
    assert 1000 * np.sqrt(np.mean(one.residuals_mm**2)) == pytest.approx(one.rms_um)
    assert one.to_table().column_names == ["phi_deg", "measured_deg", "simulated_deg", "difference_deg"]
    rows = found.to_table().to_pylist()
    assert {row["run"] for row in rows} == {str(run.path) for run in laps}
    assert next(row for row in rows if row["figure"] == "band_deg")["u"] > 0


def test_a_diagnosis_in_plain_types_and_as_a_table():
    found = diagnosis("named")
    assert found.to_dict()["condition"] == found.condition
    assert {"name", "parameter", "value", "sd", "worth_um"} <= set(found.to_table().column_names)
    assert found.curves[0].to_table().column_names[:3] == ["phi_deg", "g1_before_um", "g2_before_um"]


def test_a_run_given_twice_is_refused(laps):
    with refused("run.copied", "out here, used to fit there"):
        diagnose(laps, hold_out=laps[:1])


def test_nothing_is_printed(laps, capfd):
    compare(laps)
    evaluate_runs(laps)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("call", [compare, diagnose, lambda runs: calibrate(runs, "backlash:1")])
def test_no_runs_are_an_error_of_one_line(call):
    with refused("argument.invalid", "none is given"):
        call([])


def test_missing_pandas_names_the_package(results, monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with refused("package.missing", "pandas is not installed"):
        results[0].to_frame()


def test_a_frame_with_pandas(results):
    pytest.importorskip("pandas")
    assert list(results[0].to_frame().columns) == results[0].to_table().column_names


@pytest.fixture
def kept(laps, tmp_path):
    return save_run(laps[0], tmp_path / "acw")


def test_a_path_stands_for_its_run(laps, kept):
    assert evaluate(str(kept)).figures["band_deg"].value == pytest.approx(
        evaluate(laps[0]).figures["band_deg"].value, abs=1e-9
    )
    assert compare(kept).to_dict()["runs"]
    with refused("argument.invalid", "must be a result of evaluate,"):
        evaluate(kept, like=laps[0])


@pytest.mark.parametrize(
    ("call", "code", "where"),
    [
        (lambda: evaluate(5), "argument.invalid", "run"),
        (lambda: calibrate(5), "argument.invalid", "run"),
        (lambda: evaluate_runs([None]), "argument.invalid", "run"),
        (lambda: simulate("ur10e-cell", "yaw", "left"), "argument.invalid", "direction"),
        (lambda: simulate("ur10e-cell", "yaw"), "answer.missing", "yaw test"),
        (lambda: simulate("ur10e-cell", "yow", "cw"), "argument.invalid", "test"),
        (lambda: analysis.calibrated_arm("ur10e").forward("here"), "argument.invalid", "q_deg"),
        (lambda: analysis.calibrated_arm("ur55"), "file.missing", "ur55"),
        (lambda: analysis.calibrated_arm(5), "argument.invalid", "rig"),
        (lambda: analysis.read_table("table.csv", 5), "argument.invalid", "rig"),
        (lambda: save_run(5, "run"), "argument.invalid", "run"),
        (lambda: simulate("ur10e-cell", "yaw", "cw", seed=-1), "argument.invalid", "seed"),
        (lambda: simulate("ur10e-cell", "yaw", "cw", effects=["x"]), "argument.invalid", "effects"),
        (lambda: diagnose("run", tolerance_um=0), "argument.invalid", "tolerance_um"),
        (lambda: analysis.read_table("a.csv", "ur5", joints="read"), "argument.invalid", "joints"),
        (lambda: analysis.read_table("a.csv", "ur5", operator=None), "argument.invalid", "operator"),
    ],
)
def test_wrong_argument_is_refused_by_name(call, code, where):
    with refused(code) as error:
        call()
    assert error.value.where == where


def test_library_arm_is_found_by_name_and_takes_one_posture():
    arm = analysis.calibrated_arm("ur5")
    posture = [0.0, -90.0, 90.0, 0.0, 90.0, 0.0]
    assert arm.rig.name == "ur5" and arm.rig.robot == load_arm("ur5").robot
    assert np.allclose(arm.forward(posture).T, arm.forward([posture]).T)
    assert arm.inverse(arm.forward(posture).T[0], posture).q_deg[0] == pytest.approx(posture, abs=1e-6)


def test_columns_determine_the_test_of_a_table(tmp_path):
    rig = load("ur5")[0]
    rng = np.random.default_rng(1)
    q = rng.uniform(-100, 100, (20, 6))
    target = np.array([20.0, -10.0, 80.0, 1.0])
    seen = (analysis.calibrated_arm(rig).forward(q).T @ target)[:, [1, 0, 2]] * [1, -1, 1] + 2000
    places = seen + rng.normal(0, 0.05, (20, 3))
    lines = ["J1,J2,J3,J4,J5,J6,tracker_x_mm,tracker_y_mm,tracker_z_mm"]
    lines += [",".join(f"{value:.6f}" for value in row) for row in np.hstack([q, places])]
    (tmp_path / "poses.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    run = read_table(tmp_path / "poses.csv", "ur5")
    assert run.run.manifest.test == "pose" and evaluate(run).figures["rms_mm"].value < 0.2
    (tmp_path / "none.csv").write_text("a,b,c\n1,2,3\n4,5,6\n", encoding="utf-8")
    with refused("table.unclear", "has columns that match none of"):
        read_table(tmp_path / "none.csv", "ur5")


def test_rig_metrology_has_the_public_api():
    """Installed, this file is the module `rig_metrology`."""
    assert entry.evaluate is evaluate
    assert set(analysis.__all__) <= set(dir(entry))  # a console completes the names
    with pytest.raises(AttributeError):
        entry.analyse_runs  # noqa: B018 - the access is the test
