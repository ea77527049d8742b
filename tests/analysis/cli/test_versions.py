import datetime as dt

import pytest

from analysis.apps.plant.versions import versions
from rigs.load import load
from tests.support.command_line import errors_of, json_of, ran, succeeded
from tests.support.handmade_calibration import calibrated_model, written
from tests.support.refusals import refused


@pytest.fixture
def robot(tmp_path):
    march, _ = written(tmp_path / "march", calibrated_model(date=dt.date(2026, 3, 1), calibrated_um=3.4))
    now, _ = written(tmp_path)
    return now, march


def test_versions_are_listed_newest_first(robot):
    now, march = robot
    (now.parent / "other.yaml").write_text("no: rig\n")
    seen = json_of(f"versions {now}")["versions"]
    assert [(one["path"], one["date"], one["in_use"]) for one in seen] == [
        (str(now), "2026-11-20", True),
        (str(march), "2026-03-01", False),
    ]
    done = ran(f"versions {now}")
    assert "in use" in done.stdout
    assert f"rig compare {now} {march}" in done.stderr.replace("\n", " ")


def test_a_folder_of_very_many_files_is_refused(robot, monkeypatch):
    monkeypatch.setattr("analysis.apps.plant.versions._MOST", 1)  # private: ten thousand files take long to write
    with refused("usage", "contains more than"):
        versions(robot[0], robot[0].parent)


def test_going_back_keeps_both_versions(robot):
    now, march = robot
    before, old = now.read_text(), load(march)[0]
    succeeded(f"versions {now} --back-to {march}")
    rig, _ = load(now)
    assert rig.calibrated.calibrated_um == 3.4
    assert rig.effects == old.effects
    (kept,) = now.parent.glob("cell-until-*.yaml")
    assert kept.read_text() == before
    assert load(kept)[0].calibrated.calibrated_um == 1.9  # its calibration is still beside it
    succeeded(f"versions {now} --back-to {kept}")
    assert load(now)[0].calibrated.calibrated_um == 1.9


def test_another_robot_is_refused(robot, tmp_path):
    now, march = robot
    text = march.read_text().replace("robot:\n", "robot:\n  serial: B-2\n", 1)
    march.write_text(text)
    before = now.read_bytes()
    errors_of(f"versions {now} --back-to {march}")
    assert now.read_bytes() == before
    assert [one["path"] for one in json_of(f"versions {now}")["versions"]] == [str(now)]
    errors_of(f"versions {now} --back-to {now}")
