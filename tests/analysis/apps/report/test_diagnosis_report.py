"""Outputs of a diagnosis: screen, JSON, picture, and the files of -o."""

import json
import math
from dataclasses import replace
from typing import get_args

import numpy as np
import pytest
from matplotlib.text import Text

from analysis.apps.report.diagnosis_answer import diagnosis_answer
from analysis.apps.report.diagnosis_picture import picture
from analysis.apps.report.diagnosis_report import require_empty, write
from analysis.apps.report.diagnosis_words import micrometres, size, stretch, sure
from analysis.apps.report.model_charts import residual_charts
from analysis.apps.report.texts import texts_of
from analysis.correction.support import supports
from analysis.diagnosis.judge.acts import Act
from analysis.diagnosis.judge.residuals import ResidualBand
from analysis.diagnosis.judge.result import Condition, Gap
from analysis.diagnosis.judge.staircase import ModelResidual, Staircase, StaircaseStep
from analysis.robot.predict import model_of
from rigs.errors import FileError
from rigs.load import load
from tests.support.answers import printed
from tests.support.handmade_calibration import calibrated_model
from tests.support.handmade_diagnosis import PLACES, PLAY, ZERO, diagnosis, poses, sphere
from tests.support.nightly import cases
from tests.support.refusals import refused
from tests.support.written_files import contents

CONDITIONS = get_args(Condition)
TEXT = load("paper-fanuc")[1]
NO_PICTURE = {"curves": (), "maps": ()}
"""For tests of the other files: a picture of everything takes a second."""
KEYS = {"condition", "accuracy", "budget", "effects", "remainder", "where", "gap", "setup", "not_testable", "next_test"}
"""Those of docs/diagnosis.md that scripts rely on."""


def test_each_bar_of_the_staircase_has_its_figure():
    steps = (
        StaircaseStep((), ModelResidual(116.2, 1.0), ModelResidual(126.0, 2.0)),
        StaircaseStep((0,), ModelResidual(2.8, 1.0), ModelResidual(3.1, 2.0)),
    )
    drawn = picture(diagnosis(staircase=Staircase(steps), **NO_PICTURE)).findobj(Text)
    assert {"116.2 ± 1.0", "126.0 ± 2.0", "2.8 ± 1.0", "3.1 ± 2.0"} <= {text.get_text() for text in drawn}


def test_remedy_states_that_a_rival_is_possible(tmp_path):
    found = diagnosis("ambiguous", effects=(ZERO,), **NO_PICTURE)
    *_, rig_file = write(found, TEXT, tmp_path / "found")
    (effect,) = load(rig_file)[0].effects
    assert effect.found.rivals == ("link_geometry 5.a",)
    assert "link_geometry 5.a" in supports(load(rig_file)[0])[0].reason


@pytest.mark.parametrize("condition", CONDITIONS)
def test_the_object_has_the_keys_of_the_documents(condition):
    told = diagnosis(condition).to_dict()
    assert told["condition"] == condition and told.keys() >= KEYS
    assert told["accuracy"]["standing"] == "not_judged"
    assert told.keys() >= {"groups", "left", "doubts", "runs", "level", "repeats_measured", "seconds"}
    assert bool(told["effects"]) == (condition in ("named", "ambiguous", "out_of_range", "outside_library"))
    assert told["remainder"].keys() >= {"um", "share", "words"} and told["remainder"]["share"] == 0.05
    assert told["gap"]["unit"] == "um" and told["gap"]["unseen_place"] is None
    assert told["gap"]["held_out"].keys() >= {"before", "after", "calibrated", "noise_floor"}
    assert told["where"][0] == {
        "channel": "yaw", "direction": "cw", "part": "angle", "from_deg": 231.4, "to_deg": 243.0, "joint": 1,
        "why": "reversal", "rms_um": 14.21, "sigma": 22.4,
    }  # fmt: skip


def test_effects_and_rivals_of_the_object():
    (one,) = diagnosis("ambiguous").to_dict()["effects"]
    assert (one["effect"], one["axis"], one["posterior"]) == ("joint_offset", 5, 0.62)
    assert one["parameters"] == {"offset_deg": {"value": 0.1032, "sd": 0.0041}}
    (rival,) = one["rivals"]
    assert (rival["effect"], rival["axis"], rival["field"]) == ("link_geometry", 5, "a")
    assert rival["parameters"]["delta"] == {"value": 0.5871, "sd": 0.023} and rival["posterior"] == 0.36
    (play,) = diagnosis("named").to_dict()["effects"]
    assert (play["worth_um"], play["stands"], play["held_out_gain"]) == (5.78, True, 0.91)
    assert play["parameters"]["preload"] == {"value": 0.0, "sd": None}


def test_unknown_values_are_null_and_a_dash():
    nothing = Gap((), math.nan, math.inf, math.nan, math.nan)
    odd = replace(PLAY, sd={"width_deg": math.inf}, gap_without_um=float(np.float64("nan")))
    left = (ResidualBand("yaw", None, "angle", None, math.nan, "?"),)
    found = diagnosis(train=nothing, effects=(odd,), bands=left, levels={"others": np.float64(0.2)})
    told = found.to_dict()
    assert json.loads(json.dumps(told, allow_nan=False)) == told
    assert "nan" not in printed(diagnosis_answer(found)) and micrometres(math.nan) == "–"
    assert told["gap"]["train"]["before"] is None and told["effects"][0]["parameters"]["width_deg"]["sd"] is None


@pytest.mark.parametrize("condition", cases(CONDITIONS, ("ambiguous", "nothing_unusual")))
def test_every_condition_has_its_picture(condition, tmp_path):
    picture(diagnosis(condition, maps=(sphere(), poses()))).savefig(tmp_path / "picture.png", dpi=40)
    assert (tmp_path / "picture.png").stat().st_size > 10_000


@pytest.mark.parametrize("in_session", [False, True])
def test_picture_of_a_session_omits_the_expected_error(in_session):
    load_act = Act("load", "correction", (0,), removes_um=94.0, removes_u_um=0.8, remains_um=12.0, remains_u_um=0.8)
    sheet = picture(diagnosis(acts=(load_act,), **NO_PICTURE), in_session=in_session)
    words = [words.get_text() for part in sheet.subfigs for axes in part.axes for words in axes.texts]
    assert any("Do next: " in text for text in words) != in_session


def test_a_circle_is_shown_in_the_part_that_disagrees_most():
    chart, *_ = residual_charts(diagnosis(where=()), None, texts_of("en"))
    assert chart.title.endswith("angle")  # g1 and g2 of the curve have opposite signs
    chart, *_ = residual_charts(diagnosis(), None, texts_of("en"))
    assert chart.title.endswith("distance") and chart.shaded == ((352.0, 360.0), (0.0, 8.0))


def test_every_drawn_place_is_shaded_also_of_a_complete_lap():
    """The caption says so, and a picture of a gap of sixty times the noise had nothing shaded."""
    shaded = {chart.title: chart.shaded for chart in residual_charts(diagnosis(), None, texts_of("en"))}
    (roll,) = (stretches for title, stretches in shaded.items() if "roll acw" in title)
    assert roll == ((0.0, 360.0),)
    found = diagnosis(where=PLACES[:2])
    (both,) = (chart.shaded for chart in residual_charts(found, None, texts_of("en")) if "yaw cw" in chart.title)
    assert both == ((231.4, 243.0),)


def test_titles_distinguish_circles_of_two_places():
    both = diagnosis("named").curves
    found = replace(diagnosis("named"), staircase=None, curves=(both[0], both[0]))
    circles = residual_charts(found, None, texts_of("en"))
    assert [chart.title.rsplit(", ", 1)[1] for chart in circles[:2]] == ["place 1", "place 2"]
    alone = residual_charts(replace(found, curves=both[:1]), None, texts_of("en"))
    assert "place" not in alone[0].title


def test_the_files_of_a_named_effect(tmp_path):
    found, directory = diagnosis("named"), tmp_path / "new" / "found"
    answer, sheet, extended = write(found, TEXT, directory)
    assert contents(answer).items() >= found.to_dict().items() and sheet.name == "diagnosis.png"
    assert extended.read_text().startswith(TEXT)
    (effect,) = load(extended)[0].effects
    assert (effect.effect, effect.width_deg, effect.transit) == ("backlash", 0.05213, 0.31)
    origin = effect.found
    assert origin.runs == found.runs and origin.gap_um == (5.94, 1.91)
    assert origin.sd == {"width_deg": 0.0011, "transit": 0.042}
    model_of(load(extended)[0])


@pytest.mark.parametrize(("condition", "files"), [("ambiguous", 4), ("nothing_unusual", 4), ("not_testable_here", 2)])
def test_the_calibrated_model_is_written_unless_the_runs_show_nothing(condition, files, tmp_path):
    written = write(diagnosis(condition, calibrated=calibrated_model(), **NO_PICTURE), TEXT, tmp_path)
    assert len(written) == files == len(list(tmp_path.iterdir()))
    if files == 4:
        rig, _ = load(written[-1])
        assert [effect.effect for effect in rig.effects] == ["joint_offset"] * (condition == "ambiguous")
        assert written[-2].name == "paper-fanuc.calibration.json" and rig.calibrated == calibrated_model()


def test_a_directory_in_use_is_refused(tmp_path):
    require_empty(tmp_path)
    require_empty(tmp_path / "new")
    (tmp_path / "file").write_text("mine")
    with refused("output.exists"):
        require_empty(tmp_path)
    with refused("output.exists"):
        require_empty(tmp_path / "file")
    with pytest.raises(FileError, match="file"):
        write(diagnosis(), TEXT, tmp_path / "file" / "below")


def test_figures_in_words():
    assert [sure(p) for p in (1.0, 0.9994, 0.995, 0.62, 0.001)] == ["> 99.9 %", "> 99.9 %", "99.5 %", "62 %", "< 1 %"]
    assert size(replace(PLAY, sd={})) == "0.05213 °"
    assert stretch(PLACES[2]) == stretch(replace(PLACES[2], from_deg=82.0, to_deg=81.0)) == "whole lap"
    assert stretch(replace(PLACES[3], from_deg=4, to_deg=4)) == "target 4"
