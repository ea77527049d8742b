"""Constants of a controller that belong to another robot of the same type."""

from dataclasses import replace

import numpy as np
import pytest
import yaml

from analysis import diagnose
from analysis.correction.foreign_constants import refuse_constants_of_another, with_controller_doubts
from analysis.intake.controller_arm import rig_with_controller
from rigs.arms import rig_text_of
from rigs.edit import extended
from rigs.effects import EffectProvenance, LinkGeometry
from rigs.load import parse
from tests.support.changed_rigs import with_robot
from tests.support.handmade_diagnosis import diagnosis
from tests.support.pose_runs import pose_run
from tests.support.refusals import refused
from tests.worlds.arms.independent_arm import cell, none, postures
from tests.worlds.languages.own_constants import FRAMES, write_ur_calibration

A4_MM = 0.6
NOMINAL = {
    "shoulder": (0, 0, 0.1807, 0, 0, 0),
    "upper_arm": (0, 0, 0, np.pi / 2, 0, 0),
    "forearm": (-0.6127, 0, 0, np.pi, np.pi, -np.pi),
    "wrist_1": (-0.57155, 0, 0.17415, 0, 0, 0),
    "wrist_2": (0, -0.11985, 0, np.pi / 2, 0, 0),
    "wrist_3": (0, 0.11655, 0, np.pi / 2, np.pi, -np.pi),
}


@pytest.fixture
def files(tmp_path):
    """Factory constants of a UR10e, and those of another one with the opposite differences from the data sheet."""
    own, other = tmp_path / "own.yaml", tmp_path / "other.yaml"
    write_ur_calibration(own)
    keys = ("x", "y", "z", "roll", "pitch", "yaw")
    mirrored = {link: [2 * n - x for n, x in zip(NOMINAL[link], row, strict=True)] for link, row in FRAMES.items()}
    frames = {link: dict(zip(keys, map(float, row), strict=True)) for link, row in mirrored.items()}
    other.write_text(yaml.safe_dump({"kinematics": {**frames, "hash": "calib_2"}}, sort_keys=False))
    return own, other


def found(**sd: float) -> EffectProvenance:
    return EffectProvenance(date="2026-11-20", runs=("yaw-acw-001",), sd=sd)


def diagnosed(text: str):
    """Rig file with effects that a diagnosis found."""
    effect = LinkGeometry(axis=3, field="a", delta=0.4, found=found(delta=0.02))
    return extended(text, [effect], "cell")


def test_equal_constants_given_twice_change_nothing(files):
    text = rig_text_of("ur10e")
    rig, once, _ = rig_with_controller(parse(text, "cell"), text, files[0])
    assert rig.robot.controller_source.file == "own.yaml" and rig.robot.controller_source.serial == "calib_1"
    assert rig_with_controller(rig, once, files[0])[1] == once
    after = diagnosed(once)
    assert rig_with_controller(parse(after, "cell"), after, files[0])[0].robot == parse(after, "cell").robot


@pytest.mark.parametrize("given", ["other", "data_sheet"])
def test_other_constants_than_those_of_the_diagnosis_are_refused(files, given):
    text = rig_text_of("ur10e")
    _, once, _ = rig_with_controller(parse(text, "cell"), text, files[0])
    after = diagnosed(once)
    with refused("robot.other", "yaml calib"):
        rig_with_controller(parse(after, "cell"), after, files[1] if given == "other" else given)


def test_wrong_file_given_first_is_replaced_before_a_diagnosis(files):
    text = rig_text_of("ur10e")
    rig, wrong, _ = rig_with_controller(parse(text, "cell"), text, files[1])
    right = rig_with_controller(rig, wrong, files[0])[0]
    assert right.robot.axes == rig_with_controller(parse(text, "cell"), text, files[0])[0].robot.axes


def test_constants_that_the_calibrated_links_contradict_are_refused(files):
    """The diagnosis against the data sheet found the links of the robot of the first file."""
    text = rig_text_of("ur10e")
    sheet, own = parse(text, "cell"), rig_with_controller(parse(text, "cell"), text, files[0])[0]
    fields = {"a": "a_mm", "d": "d_mm", "alpha": "alpha_deg", "beta": "beta_deg"}
    links = [
        LinkGeometry(axis=k, field=field, delta=delta, found=found(delta=1e-3))
        for k, (axis, its) in enumerate(zip(sheet.robot.axes, own.robot.axes, strict=True), 1)
        for field, key in fields.items()
        if abs(delta := getattr(its, key) - getattr(axis, key)) > 1e-4
    ]
    after = extended(text, links, "cell")
    refuse_constants_of_another(rig_with_controller(parse(after, "cell"), after, files[0])[0], "own.yaml", anyway=False)
    with refused("robot.other", "constants are probably those of another"):
        refuse_constants_of_another(
            rig_with_controller(parse(after, "cell"), after, files[1])[0], "other.yaml", anyway=True
        )


@pytest.mark.parametrize("share", [1.0, 0.15, -1.0])
def test_constants_of_another_robot_allow_no_correction(share):
    """The constants state this share of the true difference from the data sheet."""
    rng = np.random.default_rng(7)
    wrong = replace(none(), a=np.array([0, 0, 0, A4_MM, 0, 0]))
    seen = replace(cell("ur10e", wrong, rng), noise_mm=0.015).seen(postures("ur10e", 30, rng), rng)
    run = pose_run("ur10e", seen.q, seen.xyz_mm)
    axes = list(run.rig.robot.axes)
    axes[3] = axes[3].model_copy(update={"a_mm": axes[3].a_mm + share * A4_MM})
    rig = with_robot(run.rig, axes=tuple(axes), controller="constants")
    if share < 0:
        with refused("robot.other", "its links differ from these constants"):
            diagnose(run, rig=rig)
        return
    found = diagnose(run, rig=rig)
    is_doubted = share < 1
    assert any("constants" in doubt for doubt in found.doubts) == is_doubted
    assert ([(act.kind, act.why) for act in found.acts] == [("check", "other_robot")]) == is_doubted
    after = found.extended_rig.with_calibration(None, found.calibrated)
    if is_doubted:
        with refused("robot.other", "constants that may be those of another robot"):
            refuse_constants_of_another(after, "cell.yaml", anyway=False)
    refuse_constants_of_another(after, "cell.yaml", anyway=is_doubted)


@pytest.mark.parametrize(("arm", "is_doubted"), [("ur10e", True), ("kuka-kr-10-r1100-2", False)])
def test_stated_data_sheet_is_doubted_if_the_maker_measures_each_robot(arm, is_doubted):
    rig = with_robot(parse(rig_text_of(arm), "cell"), controller="data_sheet")
    assert bool(rig.controller_doubt) is is_doubted


@pytest.mark.parametrize("is_shown", [False, True])
def test_data_sheet_of_a_diagnosis_is_doubted_unless_a_run_shows_it(is_shown):
    run = pose_run("ur10e", np.zeros((1, 6)), np.zeros((1, 3)))
    stated = with_robot(run.rig, controller="data_sheet")
    judged = with_controller_doubts(diagnosis(rig=stated), [replace(run, rig=stated)] if is_shown else [run])
    assert any("measures each robot" in doubt for doubt in judged.doubts) is not is_shown
