"""Values for a controller's parameters: entered at an independent model of it, the arm's error is gone."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from analysis.apps.correct.correct_rig import correct_rig
from analysis.apps.makers import maker_by
from rigs.edit import extended
from rigs.effects import Backlash, Compliance, Effect, JointOffset, LinkGeometry
from rigs.makers import MAKERS, maker_of
from rigs.schema.vocabulary import MakerName
from tests.support.command_line import failure_of, ran, succeeded
from tests.support.maker_controllers import NO_DELTA, Mastered, UniversalRobots
from tests.support.stated_controller import load
from tests.support.written_files import JOINTS, contents, write_columns
from tests.worlds.arms.faulty_arm import found
from tests.worlds.arms.independent_arm import Array, constants_of, flange, none

MASTERED = ("kuka", "fanuc", "abb", "yaskawa")
SCALE = np.array([4200.5, -3811.0, 4000.0, -2900.25, 3000.0, 1500.0])
"""Counts per degree of an arm that exists nowhere, two of its motors mounted the other way round."""
GEAR = SCALE / 30
TARGETS_DEG = np.array([[0.0, 20, 10, 0, 60, 0], [10, 25, 40, 20, -70, 30], [-30, 5, -20, 100, 40, 100]])
"""Away from the singularities of both arms."""


ZEROS = [
    JointOffset(axis=2, offset_deg=-0.08, found=found(offset_deg=0.002)),
    JointOffset(axis=4, offset_deg=0.05, found=found(offset_deg=0.002)),
]
OFF_DEG = np.array([0, -0.08, 0, 0.05, 0, 0])


def _cell(tmp_path: Path, rig: str, effects: Sequence[Effect]) -> Path:
    cell = tmp_path / "cell.yaml"
    text = load(rig)[1]
    cell.write_text(extended(text, effects, "cell"))
    return cell


def _printed(cell: Path, *options: str, name: str = "out") -> dict[str, Any]:
    out = cell.parent / name
    succeeded("correct", cell, "-o", out, *options)
    return contents(out / "corrections.yaml")["controller"]


def _paper_arm(q: Array) -> tuple[Array, Array]:
    R, p = flange(constants_of("paper-fanuc"), none(), q[None])
    return R[0], p[0]


def _mastered(name: MakerName) -> Mastered:
    """The paper's arm at a controller that takes its zeros for right."""
    at_zero = np.array([0.0, -90, 90, 0, 0, 0]) if name == "kuka" else np.zeros(6)
    per_deg = np.radians(1) * GEAR if name == "abb" else SCALE
    zero = np.array([1e5, -2e5, 3e4, 0, 7e3, -1e4]) * np.sign(per_deg)
    return Mastered(_paper_arm, _paper_arm, zero, per_deg, at_zero, zero, at_zero + OFF_DEG)


def _entered(controller: Mastered, entries: dict[str, Any]) -> Mastered:
    """The controller after a person has entered the values."""
    for one in entries["entries"]:
        place = "at_zero" if entries["name"] == "kuka" else "zero"
        changed = getattr(controller, place).copy()
        changed[int(one["axis"]) - 1] += one["add"]
        controller = replace(controller, **{place: changed})
    return controller


def _errors_mm(controller: Mastered | UniversalRobots, wanted: Sequence[tuple[Array, Array]]) -> Array:
    sent = [controller.sent_to(R, p, near) for (R, p), near in zip(wanted, TARGETS_DEG, strict=True)]
    return np.array([np.linalg.norm(p - goal) for (_, p), (_, goal) in zip(sent, wanted, strict=True)])


@pytest.mark.parametrize("name", MASTERED)
def test_zeros_entered_at_a_controller_that_counts_remove_the_error(tmp_path, name):
    scale = {"kuka": [], "abb": ["--scale", ",".join(map(str, GEAR))]}.get(name, ["--scale", ",".join(map(str, SCALE))])
    entries = _printed(_cell(tmp_path, "paper-fanuc", ZEROS), "--for", name, *scale)
    controller = _mastered(name)
    wanted = [_paper_arm(np.radians(q)) for q in TARGETS_DEG]
    before, after = _errors_mm(controller, wanted), _errors_mm(_entered(controller, entries), wanted)
    assert before.min() > 0.3
    assert after.max() < 1e-3
    assert not {"delta_a", "delta_alpha"} & {one["parameter"].partition("[")[0] for one in entries["entries"]}
    # What the program tells the person to check at an unchanged posture.
    counts = controller.counts_at(TARGETS_DEG[1])
    more_deg = _entered(controller, entries).reading_deg(counts) - controller.reading_deg(counts)
    told_deg = np.zeros(6)
    for one in entries["entries"]:
        told_deg[one["axis"] - 1] += one["reading_deg"]
    np.testing.assert_allclose(more_deg, told_deg, atol=1e-7)


def _ur10e(real: dict[str, Array]) -> UniversalRobots:
    """Constants in the maker's table of the UR10e: support.universal-robots.com, DH parameters."""
    a, d = np.array([0, -0.6127, -0.57155, 0, 0, 0]), np.array([0.1807, 0, 0, 0.17415, 0.11985, 0.11655])
    alpha = np.array([np.pi / 2, 0, 0, np.pi / 2, -np.pi / 2, 0])
    return UniversalRobots(a, alpha, d, NO_DELTA, NO_DELTA | real)


def test_deltas_added_to_a_universal_robot_remove_the_error_of_zeros_and_offsets(tmp_path):
    faults = [
        *ZEROS,
        LinkGeometry(axis=5, field="d", delta=-0.4, found=found(delta=0.02)),
    ]
    real = {"delta_theta": np.radians(OFF_DEG), "delta_d": np.array([0, 0, 0, 0, -0.4e-3, 0])}
    controller = _ur10e(real)
    entries = _printed(_cell(tmp_path, "ur10e-cell", faults))
    assert entries["name"] == "ur"
    wanted = [controller.flange(np.radians(q), NO_DELTA) for q in TARGETS_DEG]
    before = _errors_mm(controller, wanted)
    for one in entries["entries"]:
        parameter, _, index = one["parameter"].rstrip("]").partition("[")
        assert one["reading_deg"] == 0
        controller = controller.with_added(parameter, int(index), one["add"])
    after = _errors_mm(controller, wanted)
    assert before.min() > 0.3
    assert after.max() < 1e-3


@pytest.mark.parametrize("rig", ["paper-fanuc", "ur10e-cell"])
def test_a_path_for_a_controller_with_its_entries_holds_the_rest(tmp_path, rig):
    """With zeros entered and a compliant joint, corrected joint angles reach the same place as the complete
    correction alone.
    """
    soft = Compliance(axis=3, deg_per_Nm=2e-4, found=found(deg_per_Nm=1e-5))
    cell = load(rig)[0].model_copy(update={"effects": (*ZEROS, soft)})
    path = write_columns(tmp_path / "path.csv", JOINTS, TARGETS_DEG)
    name = maker_of(cell.feedback.interface) or "fanuc"
    alone, entered = (correct_rig(cell, path, name, entered=flag).path for flag in (False, True))
    more_deg = np.degrees(entered[2].q - alone[2].q)
    values = correct_rig(cell, path, name).at_controller
    assert len(values.entries) > 2, "zeros and lengths hold a part of the soft joint too"
    reading_deg = np.zeros(6)
    for one in values.entries:
        reading_deg[one.axis - 1] += one.reading_deg
    assert maker_by(name).controller.changes_reading == reading_deg.any()
    np.testing.assert_allclose(more_deg, np.tile(reading_deg, (3, 1)), atol=1e-9)


def test_effects_without_a_constant_are_listed_with_their_error(tmp_path):
    play = Backlash(axis=1, width_deg=0.05, found=found(width_deg=0.001))
    base = LinkGeometry(axis=1, field="d", delta=0.5, found=found(delta=0.003))
    entries = _printed(_cell(tmp_path, "ur10e-cell", [ZEROS[0], base, play]))
    assert [one["parameter"] for one in entries["entries"]] == ["delta_theta[2]", "delta_d[1]"]
    assert entries["entries"][1]["add"] == pytest.approx(0.5e-3, rel=1e-3)
    assert entries["entries"][1]["worth_um"] == pytest.approx(500, rel=1e-3), "d1 moves the tool by itself, everywhere"
    assert entries["entries"][1]["leaves_um"] == pytest.approx(3, rel=0.05)
    (left,) = entries["not_entered"]
    assert left["name"] == "backlash 1" and left["worth_um"] > 100
    assert entries["after_um"] == pytest.approx(np.hypot(left["worth_um"], 3), rel=0.05)
    assert entries["corrected_targets_um"] == pytest.approx(entries["after_um"], rel=1e-3)


def test_an_entry_that_gains_nothing_for_certain_is_not_made(tmp_path):
    """A zero with a size of 2.2 u is not entered together with the zero of a fault. Of many equally uncertain zeros,
    enough
    are entered that the omitted ones together have no significant gain.
    """
    fault = JointOffset(axis=3, offset_deg=0.05, found=found(offset_deg=0.004))
    unsure = [JointOffset(axis=axis, offset_deg=0.033, found=found(offset_deg=0.015)) for axis in (2, 4, 5)]
    entered = _printed(_cell(tmp_path, "paper-fanuc", [fault, unsure[0]]), "--for", "fanuc")
    assert [one["parameter"] for one in entered["entries"]] == ["reading of axis 3"]
    many = [one.model_copy(update={"found": found(offset_deg=0.009)}) for one in unsure]
    entered = _printed(_cell(tmp_path, "paper-fanuc", [fault, *many]), "--for", "fanuc", name="all")
    assert 1 < len(entered["entries"]) < 4


def test_twin_effects_share_the_uncertainty_of_their_sum(tmp_path):
    """d2, d3 and d4 of three parallel axes do the same to every posture."""
    cell = _cell(tmp_path, "ur10e-cell", [LinkGeometry(axis=2, field="d", delta=0.3, found=found(delta=0.03))])
    entries = _printed(cell)
    assert [one["parameter"] for one in entries["entries"]] == ["delta_d[2]", "delta_d[3]", "delta_d[4]"]
    assert [one["add"] for one in entries["entries"]] == pytest.approx([1e-4] * 3, rel=1e-3)
    assert [one["u"] for one in entries["entries"]] == pytest.approx([1e-5] * 3, rel=1e-3)
    assert entries["known_only_together"] == [["delta_d[2]", "delta_d[3]", "delta_d[4]"]]
    # The whole arm stands elsewhere by most of it, which a frame taught with the robot does not show.
    assert entries["after_um"] == pytest.approx(entries["before_um"] / 10, rel=0.01)
    assert entries["before_um"] < 150 and 20 < entries["base_u_um"] < 30


def test_without_a_scale_counts_are_degrees_of_the_reading(tmp_path):
    cell = _cell(tmp_path, "paper-fanuc", ZEROS)
    done = ran(f"correct {cell} -o {tmp_path}/out --for fanuc")
    assert "--scale" in done.stdout
    entries = contents(tmp_path / "out" / "corrections.yaml")["controller"]
    assert [(one["parameter"], round(one["add"], 6), one["unit"]) for one in entries["entries"]] == [
        ("reading of axis 2", -0.08, "deg"),
        ("reading of axis 4", 0.05, "deg"),
    ]


J3_SHOWN = np.eye(6)
J3_SHOWN[2, 1] = -1


@pytest.mark.parametrize("unit", ["counts", "deg"])
@pytest.mark.parametrize("elbow_deg", [0.0, 0.11])
def test_zeros_remove_the_error_if_the_controller_couples_the_displayed_angles(tmp_path, unit, elbow_deg):
    zeros = [*ZEROS, JointOffset(axis=3, offset_deg=elbow_deg, found=found(offset_deg=0.002))]
    text = load("paper-fanuc")[1].replace("    - [0, 0, -1, 0, 0, 0]", "    - [0, -1, -1, 0, 0, 0]")
    cell = tmp_path / "cell.yaml"
    cell.write_text(extended(text, zeros if elbow_deg else ZEROS, "cell"))
    scale = ["--scale", ",".join(map(str, SCALE))] if unit == "counts" else []
    entries = _printed(cell, "--for", "fanuc", *scale)
    controller = replace(
        _mastered("fanuc"),
        model=lambda q: _paper_arm(np.linalg.solve(J3_SHOWN, q)),
        true_at_zero=OFF_DEG + elbow_deg * np.eye(6)[2],
        shown=J3_SHOWN,
    )
    wanted = [_paper_arm(np.radians(q)) for q in TARGETS_DEG]
    counts, mastered = controller.counts_at(TARGETS_DEG[1]), controller
    for one in entries["entries"]:
        zero, k = mastered.zero.copy(), one["axis"] - 1
        more_deg = mastered.reading_deg(counts)[k] - controller.reading_deg(counts)[k]
        assert one["unit"] == unit
        zero[k] += one["add"] if unit == "counts" else -SCALE[k] * (one["add"] - more_deg)
        mastered = replace(mastered, zero=zero)
    assert _errors_mm(controller, wanted).min() > 0.3
    assert _errors_mm(mastered, wanted).max() < 1e-3
    read_deg = mastered.reading_deg(counts) - controller.reading_deg(counts)
    np.testing.assert_allclose(read_deg, entries["readings_deg"], atol=1e-7)


@pytest.mark.parametrize(
    ("options", "code"),
    [
        ("--for kuka --scale 1,2,3,4,5,6", "usage"),
        ("--for abb --scale 1,2,3", "usage"),
        ("--for abb --scale 1,2,3,4,5,0", "usage"),
        ("--entered", "usage"),
        ("--for cuca", "usage"),
    ],
)
def test_wrong_use_is_refused(tmp_path, options, code):
    cell = _cell(tmp_path, "paper-fanuc", ZEROS)
    assert failure_of(f"correct {cell} -o {tmp_path}/out {options}") == (2, code)
    assert not (tmp_path / "out").exists()


def test_a_feedback_that_serves_several_makers_names_no_controller(tmp_path):
    assert maker_of(load("paper-fanuc")[0].feedback.interface) is None
    cell = _cell(tmp_path, "paper-fanuc", ZEROS)
    done = ran(f"correct {cell} -o {tmp_path}/out --json")
    assert json.loads(done.stdout)["controller"] is None
    assert f"next: rig correct {cell} --for fanuc -o {tmp_path / 'out-fanuc'}  # " in done.stderr


@pytest.mark.parametrize("name", MAKERS)
def test_effects_that_nobody_measured_are_entered_nowhere_and_the_table_says_why(tmp_path, name):
    cell = _cell(tmp_path, "paper-fanuc", [JointOffset(axis=3, offset_deg=0.05)])
    done = succeeded(f"correct {cell} -o {tmp_path}/out --controller {name.upper()}")
    assert "(682 µm rms)" in " ".join(done.stdout.split())
    written = contents(tmp_path / "out" / "corrections.yaml")
    (effect,) = written["effects"]
    assert effect["corrected_as"] is None and effect["reason"] and not written["controller"]["entries"]
