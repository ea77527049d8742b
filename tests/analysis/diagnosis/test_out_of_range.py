"""Parameters that are further off than a search corrects: one name with its estimate, and nothing invented next to it.

The readings are of `tests.worlds.arms.independent_arm`, whose kinematics are not those of the product.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from analysis.apps.report.act_words import ActWords
from analysis.apps.report.diagnosis_report import write, write_model
from analysis.apps.report.summary_words import summarise
from analysis.apps.report.texts import keys_of
from analysis.diagnosis.fit import out_of_range
from analysis.diagnosis.judge.result import Diagnosis
from rigs.effects import LinkGeometry
from rigs.errors import FileError
from rigs.load import load
from rigs.schema.effect import name_of, size_field
from tests.support.diagnosis_cells import found_in, remounted_circles
from tests.support.handmade_diagnosis import FAR, diagnosis
from tests.support.nightly import cases
from tests.support.pose_runs import pose_run
from tests.worlds.arms.independent_arm import Wrong, constants_of, flange, none

_POSES = 50
_TOOL_MM = np.array([40.0, 25.0, 130.0])


def _found(wrong: Wrong, seed: int) -> Diagnosis:
    """The diagnosis of poses of a UR10e that has errors of a fifth of the usual size next to those given."""
    rng = np.random.default_rng(seed)
    low, high = np.radians([(-85, -130, 50, -120, -110, -150), (85, -55, 120, -40, -50, 150)])
    q = rng.uniform(low, high, (_POSES, 6))
    small = replace(
        wrong, a=wrong.a + rng.normal(0, 0.04, 6), offset=wrong.offset + rng.normal(0, np.radians(0.004), 6)
    )
    R, p = flange(constants_of("ur10e"), small, q)
    places = p + R @ _TOOL_MM + [2100.0, -800.0, 600.0] + rng.normal(0, 0.03, (_POSES, 3))
    return found_in([pose_run("ur10e", q, places)], load("ur10e")[0])


_FAR_OFF = (
    ("a", 3, -30.0, "link_geometry 3.a"),
    ("offset", 3, np.radians(10.0), "joint_offset 3"),
    ("offset", 2, np.radians(-10.0), "joint_offset 2"),
)


@pytest.mark.parametrize(("field", "axis", "value", "name"), cases(_FAR_OFF, _FAR_OFF[:2]))
def test_one_parameter_beyond_its_limit_is_the_only_name_with_its_estimate(
    field: str, axis: int, value: float, name: str
) -> None:
    """A length wrong by -30 mm was three faults, of which two were invented."""
    off = np.zeros(6)
    off[axis - 1] = value
    found = _found(replace(none(), **{field: off}), seed=axis)
    (named,) = found.effects
    planted = np.degrees(value) if field == "offset" else value
    assert (found.condition, name_of(named.effect), named.is_confirmed) == ("out_of_range", name, True)
    assert getattr(named.effect, size_field(named.effect)) == pytest.approx(planted, rel=0.01)
    assert found.train.after_um < 0.1 * found.train.before_um
    assert [act.kind for act in found.acts] == ["check"] and found.calibrated is None


def test_large_difference_from_the_data_sheet_is_no_fault_and_is_checked_in_the_rig_file() -> None:
    found = _found(replace(none(), a=np.array([0, 0, -15.0, 0, 0, 0])), seed=5)
    assert found.condition == "uncalibrated" and found.calibrated is not None
    assert [act.kind for act in found.acts][:2] == ["check", "load"]  # a correction would hide a wrong rig file
    assert not found.standing and found.budget[0].rank == "difference"
    assert found.budget[0].name == "link_geometry 3.a"


@pytest.mark.parametrize(("initial_um", "is_found"), [(9.0, False), (2000.0, True)])
def test_a_parameter_that_explains_little_is_not_out_of_range(
    initial_um: float, is_found: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A coupling of 6 µm was told as a height of the base, out of range, which a circle hardly shows."""
    far = LinkGeometry(axis=1, field="d", delta=30.0)
    residuals: dict[tuple[object, ...], float] = {(): initial_um}
    fitted = SimpleNamespace(residual_um=lambda effects: residuals.get(tuple(effects), 7.4))
    monkeypatch.setattr(out_of_range, "FittedRuns", lambda runs: fitted)
    monkeypatch.setattr(out_of_range, "_likely_constants", lambda result: [])  # private: it would need columns
    monkeypatch.setattr(out_of_range, "_fitted_alone", lambda fitted, effect: (7.4, effect))  # private: no runs here
    monkeypatch.setattr(out_of_range, "ended_at_limit", lambda effect: True)
    result: Any = SimpleNamespace(effects=(far,))
    residuals[(far,)] = 7.5
    found = out_of_range.find_out_of_range(result, [])
    assert (found is not None and found.effect == far) == is_found


@pytest.mark.nightly
@pytest.mark.cpu_limit(180)  # the search within the limits takes a minute
def test_circles_show_it_too() -> None:
    """The arm of a circle test, with its ball set up where the wrong tool goes."""
    far = FAR.effect.model_copy(update={"offset_deg": 8.0})
    found = found_in(remounted_circles(far)[0])
    (named,) = found.effects
    assert found.condition == "out_of_range" and name_of(named.effect) == "joint_offset 5"
    assert getattr(named.effect, size_field(named.effect)) == pytest.approx(8.0, abs=0.05)


def test_the_first_sentence_names_it_and_the_limit_and_the_act_says_what_to_check() -> None:
    found = diagnosis("out_of_range")
    headline = summarise(found).headline
    assert keys_of(headline)[0] == "finding_out_of_range"
    assert "9.8132 ± 0.0041 °" in headline and "5 °" in headline
    assert keys_of(ActWords(found).next)[0] == "act_check"


def test_no_model_of_it_is_written(tmp_path: Path) -> None:
    """A rig file with it would be refused: it is beyond the bounds of the schema."""
    found = diagnosis("out_of_range")
    written = write(found, "name: cell\n", tmp_path / "found")
    assert [path.name for path in written] == ["diagnosis.json", "diagnosis.png"]
    answer = json.loads(written[0].read_text())
    assert answer["condition"] == "out_of_range" and answer["accuracy"]["calibrated_um"] is None
    with pytest.raises(FileError, match="joint_offset 5 "):
        write_model(found, "name: cell\n", tmp_path / "cell.yaml")
