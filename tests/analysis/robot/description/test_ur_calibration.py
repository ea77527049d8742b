"""A UR's calibration.conf, against a product of classic Denavit-Hartenberg steps with its differences added.

The lists of tests/support/calibrations are of real arms, a UR3 and a UR5 of the first series, as their owners published
them in questions (MyRobotLab/pyrobotlab issue 145, ros-industrial-attic/ur_modern_driver issue 179). They are put on a
UR3e and a UR5e here: the arithmetic is the same.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from analysis.robot.description.rig_section import flange_poses, parsed
from analysis.robot.description.ros_kinematics import calibrated
from rigs.arms import load_arm
from rigs.errors import FileError
from tests.support.second_sources import Numbers, classic

FILES = Path(__file__).parents[3] / "support" / "calibrations"
GOOD = (FILES / "ur3.conf").read_text(encoding="utf-8")
PUBLISHED = {
    "ur3e": ("ur3.conf", (0, -243.55, -213.2, 0, 0, 0), (151.85, 0, 0, 131.05, 85.35, 92.1)),
    "ur5e": ("ur5.conf", (0, -425, -392.2, 0, 0, 0), (162.5, 0, 0, 133.3, 99.7, 99.6)),
}
"""By arm: the file that is put on it, and its classic a and d as published, in mm."""


def classic_rows(file: Path, a: Numbers, d: Numbers) -> list[Numbers]:
    """theta (degrees), d, a (mm), alpha (degrees) with the differences of a file (rad, m)."""

    def differences(name: str) -> list[float]:
        found = re.search(rf"delta_{name} = \[(.*)\]", file.read_text(encoding="utf-8"))
        assert found
        return [float(word) for word in found.group(1).split(",")]

    alpha = np.degrees(np.array([np.pi / 2, 0, 0, np.pi / 2, -np.pi / 2, 0]) + differences("alpha"))
    own_a, own_d = np.array(a) + 1000 * np.array(differences("a")), np.array(d) + 1000 * np.array(differences("d"))
    return list(zip(np.degrees(differences("theta")), own_d, own_a, alpha, strict=True))


def conf(folder: Path, text: str) -> Path:
    file = folder / "calibration.conf"
    file.write_text(text, encoding="utf-8")
    return file


@pytest.mark.parametrize("name", PUBLISHED)
def test_the_section_is_the_calibrated_arm(name: str) -> None:
    file, a, d = PUBLISHED[name]
    found = calibrated(load_arm(name), FILES / file)
    assert parsed(found.section.text) == found.section.robot
    assert all(abs(axis.d_mm) < 1000 and abs(axis.a_mm) < 1000 for axis in found.section.robot.axes)
    q = np.random.default_rng(7).uniform(-2 * np.pi, 2 * np.pi, (1000, 6))
    # The rounding of radians to degrees and back, and of lengths of 278 m, is part of the reference here.
    np.testing.assert_allclose(
        flange_poses(found.section.robot, q), classic(classic_rows(FILES / file, a, d))(q), atol=2e-9, rtol=0
    )
    assert found.section.largest_mm < 2e-9
    assert 0.1 < found.moved_mm < 50
    assert found.doubts == ()


def test_centres_of_mass_move_with_their_links_by_no_more_than_the_arm() -> None:
    nominal = load_arm("ur3e").robot
    own = calibrated(load_arm("ur3e"), FILES / "ur3.conf").section.robot
    for ours, its in zip(nominal.axes, own.axes, strict=True):
        assert its.mass_kg == ours.mass_kg
        assert np.linalg.norm(its.centre_mm) < np.linalg.norm(ours.centre_mm) + 200


def test_no_differences_are_the_published_arm(tmp_path: Path) -> None:
    lists = "\n".join(f"delta_{name} = [0, 0, 0, 0, 0, 0]" for name in ("theta", "a", "d", "alpha"))
    found = calibrated(load_arm("ur10e"), conf(tmp_path, f"[mounting]\n{lists}\ncalibration_status = 0\n"))
    assert found.moved_mm < 1e-9
    assert found.doubts == ("calibration_status is 0: the arm was not calibrated",)
    for own, nominal in zip(found.section.robot.axes, load_arm("ur10e").robot.axes, strict=True):
        assert abs(own.a_mm) == pytest.approx(abs(nominal.a_mm), abs=1e-9)
        assert own.beta_deg == 0


def test_the_file_of_another_kind_of_arm_is_doubted(tmp_path: Path) -> None:
    text = GOOD.replace("0.034503078453104935", "0.134503078453104935")
    (doubt,) = calibrated(load_arm("ur3e"), conf(tmp_path, text)).doubts
    assert "check that the file is of this model" in doubt


BAD = {
    "no section": (GOOD.replace("[mounting]", "[base]"), "has no section [mounting]"),
    "no list": (GOOD.replace("delta_alpha", "alpha"), "has no delta_alpha"),
    "five": (re.sub(r"delta_a = \[[^,]*,", "delta_a = [", GOOD), "delta_a is not a list of six numbers"),
    "nan": (re.sub(r"delta_a = \[[^,]*,", "delta_a = [NaN,", GOOD), "delta_a is not a list of six numbers"),
    "huge": (re.sub(r"delta_a = \[[^,]*,", "delta_a = [1" + "0" * 400 + ",", GOOD), "delta_a is not a list of six"),
    "1e308": (re.sub(r"delta_a = \[[^,]*,", "delta_a = [1e308,", GOOD), "delta_a is not a list of six numbers"),
    "100 km": (re.sub(r"delta_a = \[[^,]*,", "delta_a = [1e5,", GOOD), "correct it: the units are metres and radians"),
    "words": (re.sub(r"delta_a = .*", "delta_a = small", GOOD), "delta_a is not a list of six numbers"),
    "nested": (re.sub(r"delta_a = .*", "delta_a = " + "[" * 50_000, GOOD), "delta_a is not a list of six numbers"),
    "no header": (GOOD.replace("[mounting]\n", ""), "contains no section headers"),
    "twice": (GOOD + "calibration_status = 0\n", "already exists"),
    "large": (GOOD + "#" * 200_000, "is larger than"),
}


@pytest.mark.parametrize("kind", BAD)
def test_a_bad_file_is_refused_in_one_line_with_a_remedy(kind: str, tmp_path: Path) -> None:
    text, what = BAD[kind]
    with pytest.raises(FileError) as refused:
        calibrated(load_arm("ur3e"), conf(tmp_path, text))
    assert what in str(refused.value)
    assert len(refused.value.lines()) == 1


@pytest.mark.parametrize("data", [b"\xff\xfe\x00", None])
def test_what_is_no_text_is_refused(data: bytes | None, tmp_path: Path) -> None:
    file = tmp_path / "calibration.conf"
    if data is not None:
        file.write_bytes(data)
    with pytest.raises(FileError):
        calibrated(load_arm("ur3e"), file)


def test_an_arm_of_another_maker_has_no_such_file(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="only the arms of Universal Robots do"):
        calibrated(load_arm("abb-irb-120"), conf(tmp_path, GOOD))
