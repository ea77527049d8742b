"""One posture, stated by the user, for all targets of a program whose posture the text leaves open."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from analysis.apps.correct.corrected_program import CorrectedProgram, correct_program
from analysis.apps.correct.postures import ProgramPostures
from analysis.apps.correct.stated_points import computed_points
from tests.analysis.apps.correct.programs.cells import ABB, TCP, UR, Files, corrected_cell, module_of, uncorrected
from tests.support.nightly import cases
from tests.worlds.arms.independent_arm import Array
from tests.worlds.languages import rapid
from tests.worlds.languages.arms import cell, chain
from tests.worlds.languages.execution import Ended, Reached, Ways, World

_LOW, _HIGH = np.radians([(-80, -15, -30, -110, 20, -170), (80, 45, 35, 110, 100, 170)])
"""Range of the drawn joint angles: one side of shoulder, elbow and wrist. A joint move may cross most of it."""
_SAME_MM = 0.01


def _drawn(rng: np.random.Generator, moves: int) -> tuple[Array, str]:
    """Joint angles (moves, 6) rad of targets, and a program that reaches them without a posture in its text."""
    q = rng.uniform(_LOW, _HIGH, (moves, 6)) * np.where(np.arange(6) == 4, rng.choice([-1, 1]), 1)
    lines = ["MODULE M", "PROC main()", "ConfL\\Off;", "ConfJ\\Off;"]
    for T in (chain(cell("abb"), each)[0] for each in q):
        place = ",".join(f"{value:.4f}" for value in T[:3, 3])
        turn = ",".join(f"{value:.9f}" for value in Rotation.from_matrix(T[:3, :3]).as_quat(scalar_first=True))
        external = ",".join(["9E9"] * 6)
        lines.append(f"MoveJ [[{place}],[{turn}],[0,0,0,0],[{external}]],v100,fine,tool0;")
    return q, "\n".join([*lines, "ENDPROC", "ENDMODULE", ""])


def _driven(text: str, start: Array) -> list[Reached]:
    machine = rapid.Machine(rapid.Program({"M.mod": text}, "M.mod"), World(0), Ways())
    machine.robot.q = start
    with suppress(Ended):
        machine.run()
    return list(machine.robot.reached)


def _off_mm(driven: Sequence[Reached], wanted: Sequence[Reached]) -> Array:
    """Distance (n,) of the real flange from where the original text wants it."""
    places = cell("abb").flanges(np.array([one.q for one in driven]))[:, :3, 3]
    return np.linalg.norm(places - [one.F[:3, 3] for one in wanted], axis=1)


def _stated(directory: Path, text: str, near: Array | None) -> CorrectedProgram:
    (directory / "M.mod").write_text(text)
    postures = ProgramPostures(near=None if near is None else tuple(near.tolist()))
    return correct_program(computed_points(cell("abb").rig), directory / "M.mod", postures=postures)


@pytest.mark.parametrize("seed", cases(range(60), range(12)))
def test_true_statement_serves_every_target_and_a_false_one_names_where_to_look(tmp_path, seed):
    q, text = _drawn(np.random.default_rng(seed), 12)
    assert not _stated(tmp_path, text, None).places
    found, before = _stated(tmp_path, text, q[0]), _driven(text, q[0])
    at_wrist = np.array([np.sign(one.q[4]) == np.sign(q[0, 4]) for one in before])
    lines = [line for _, line in found.places]
    if not lines:  # a move contradicts the statement
        reasons = {one.reason for one in found.left}
        assert "other_posture" in reasons and not found.by_user
        assert not at_wrist.all()
        return
    assert len(lines) == len(q)
    after = _driven(found.files["M.mod"].decode(), q[0])
    held = len(at_wrist) if at_wrist.all() else int(at_wrist.argmin())
    assert (_off_mm(after[:held], before[:held]) < _SAME_MM).all()
    assert (_off_mm(before, before) > 0.05).any()
    if not at_wrist.all():
        assert lines[held] in {line for _, line in found.by_user}


def _abb(*lines: str) -> Files:
    return module_of("ConfL\\Off;\nConfJ\\Off;\n" + "".join(f"{line},v9,fine,t;\n" for line in lines))


@pytest.mark.parametrize(
    ("maker", "files", "near_deg", "reasons"),
    [
        ("ur", {"a.script": TCP + "movel({p1})\nmovel({p2})\n"}, UR[1], []),
        ("abb", _abb("MoveJ {p0}", "MoveL {p3}"), ABB[0], []),
        ("abb", _abb("MoveAbsJ {q0}", "MoveL {p3}", "MoveL {p0}"), (20, 10, 20, 30 - 180, -60, -40 + 180), []),
        ("abb", _abb("MoveL {p3}", "MoveAbsJ {q0}"), (20, 10, 20, 30, 60, -40), []),
    ],
)
def test_stated_posture_is_that_of_targets_for_which_the_text_has_none(tmp_path, maker, files, near_deg, reasons):
    found = corrected_cell(maker, tmp_path, files, near=tuple(np.radians(near_deg)))
    assert [reason for _, reason in uncorrected(found)] == reasons


def test_statement_that_a_move_contradicts_is_not_used(tmp_path):
    other = (20, 10, 20, 30 - 180, -60, -40 + 180)
    files = _abb("MoveJ {p0}", "MoveL {p1}", "MoveAbsJ {q3}", "MoveL {p3}")  # and begins again
    found = corrected_cell("abb", tmp_path, files, near=tuple(np.radians(other)))
    assert (7, "other_posture") in uncorrected(found) and found.near is None
    assert [line for _, line in found.places] == [9, 10]
