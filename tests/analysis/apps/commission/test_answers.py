"""Answers that are kept between two runs of rig init: private, bounded, and checked when they are read."""

from pathlib import Path

import pytest

from analysis.apps.commission.init_answers import (
    Answers,
    Options,
    forget_answers,
    keep_answers,
    kept_in,
    load_answers,
)
from analysis.apps.commission.questionnaire import _with_options  # private: a terminal would have to be interrupted
from rigs.errors import FileError
from rigs.schema.robot import Pose
from tests.support.drivers import keyence, modbus, rtde
from tests.support.refusals import refused

ANSWERS = Answers(
    robot_address="robot",
    feedback=rtde(rate_hz=125),
    gauges=(modbus(), keyence(channel=2, line="38400 8N1")),
    baseline_mm=50.0,
    arm="ur10e",
    tool=Pose(xyz_mm=(0, 0, 150)),
)


def test_stored_answers_are_read_back(tmp_path):
    rig_file = tmp_path / "cell.yaml"
    assert load_answers(rig_file) == Answers()
    keep_answers(rig_file, ANSWERS)
    assert load_answers(rig_file) == ANSWERS
    keep_answers(rig_file, Answers(arm="ur10"))
    assert load_answers(rig_file) == Answers(arm="ur10")
    forget_answers(rig_file)
    forget_answers(rig_file)
    assert not list(tmp_path.iterdir())


def test_only_the_owner_can_read_them(tmp_path):
    keep_answers(tmp_path / "cell.yaml", ANSWERS)
    assert kept_in(tmp_path / "cell.yaml").stat().st_mode & 0o777 == 0o600


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"{",
        b"[]",
        b"\xff\xfe",
        b'{"arm": 3}',
        b'{"os": "system"}',
        b'{"gauges": [{"interface": "none"}]}',
        b"x" * 200_000,
    ],
)
def test_damaged_answers_are_one_line(tmp_path, data):
    kept_in(tmp_path / "cell.yaml").write_bytes(data)
    with pytest.raises(FileError) as error:
        load_answers(tmp_path / "cell.yaml")
    assert len(error.value.lines()) == 1 and "cell.yaml.init" in error.value.where


def test_a_directory_that_cannot_be_written(tmp_path):
    with refused("output.not_writable", "No such file or directory"):
        keep_answers(tmp_path / "none" / "cell.yaml", ANSWERS)


def test_questions_that_did_not_apply_before_are_open_again():
    stored = Answers(arm="ur10", build=None, gauges=(modbus(),), baseline_mm=None, circle=None)

    def fields(given, places=()):
        keys = {"g1": {}, "g2": {}, "feedback": {}}
        options = Options(Path("cell.yaml"), "cell", "gauges", None, (), places, keys, given, None, None, 0.3, (1,))
        return _with_options(stored, options).model_fields_set

    assert fields({}) == fields({"arm": "ur10"}) == stored.model_fields_set
    assert fields({"arm": "ur10e"}) == stored.model_fields_set - {"build"}
    assert fields({}, ("tcp://a:502", "tcp://b:502")) == {"arm", "build", "circle"}
