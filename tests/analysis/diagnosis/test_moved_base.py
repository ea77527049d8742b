from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from analysis import diagnose
from analysis.diagnosis.judge.result import Diagnosis
from analysis.movement.between import without_moved
from analysis.movement.inference import MOST_ODDS
from analysis.runs.loading import Measured
from rigs.load import load
from tests.support.handmade_diagnosis import diagnosis
from tests.support.pose_runs import pose_run
from tests.worlds.arms.independent_arm import constants_of, flange, none

RIG = load("ur10e")[0].model_copy(update={"effects": ()})
TOOL_MM = np.array([40.0, 25.0, 130.0])


def _run(name: str, poses: int, *, base_mm: tuple[float, float, float] = (0, 0, 0), turn_deg: float = 0) -> Measured:
    """Poses of an arm with small errors; the base, or the zero of the first axis, differs from that at the start."""
    rng = np.random.default_rng([poses, *name.encode()])
    small = np.random.default_rng(4)
    wrong = replace(none(), a=small.normal(0, 0.1, 6), offset=np.radians(small.normal(0, 0.02, 6)))
    low, high = np.radians([(-85, -130, 50, -120, -110, -150), (85, -55, 120, -40, -50, 150)])
    q: NDArray[np.float64] = rng.uniform(low, high, (poses, 6))
    R, p = flange(constants_of("ur10e"), wrong, q + np.radians([turn_deg, 0, 0, 0, 0, 0]))
    places = p + R @ TOOL_MM + [2100.0, -800.0, 600.0] + base_mm + rng.normal(0, 0.02, (poses, 3))
    return pose_run("ur10e", q, places, name)


def test_runs_after_a_moved_base_have_a_placement_of_their_own():
    """A base that moved by 1.3 mm was reported, but fitted as one placement: 0.5 mm then counted as scatter."""
    runs = [_run("before", 40), _run("after", 20, base_mm=(0.5, -1.1, 0.3))]
    runs.append(_run("third", 20, base_mm=(0.5, 0.4, 0.3)))
    sound, movements, doubts = without_moved(RIG, runs)
    assert [(movement.from_, movement.to, movement.what) for movement in movements] == [
        ("before", "after", "base"), ("after", "third", "base")
    ]  # fmt: skip
    assert [run.run.manifest.placement for run in sound] == ["door", "door from after", "door from third"]
    assert [movement.to_dict()["alike"] for movement in movements] == ["instrument"] * 2  # as in the sentence
    assert any(doubt.startswith("third and later") for doubt in doubts)


def test_a_diagnosis_after_a_moved_base_begins_with_it(monkeypatch):
    """The search for causes takes a minute and is replaced: it gets only the runs without the movement."""
    searched: list[str] = []

    def diagnosed(_: object, runs: list[Measured], *others: object) -> Diagnosis:
        searched.extend(run.run.manifest.placement for run in runs)
        return diagnosis("nothing_unusual", acts=())

    monkeypatch.setattr("analysis.diagnosis.diagnose.diagnose", diagnosed)
    found = diagnose([_run("before", 40), _run("after", 20, base_mm=(0.5, -1.1, 0.3))])
    assert searched == ["door", "door from after"]
    assert [act.why for act in found.acts] == ["moved"] and any("separate placement" in doubt for doubt in found.doubts)


def test_zero_of_axis_1_and_rotated_base_are_indistinguishable():
    """The readings of both are equal, and re-mastering a sound axis makes an arm worse."""
    _, (movement,), _ = without_moved(RIG, [_run("before", 40), _run("after", 20, turn_deg=0.1)])
    assert (movement.what, movement.axis, movement.alike, movement.odds) == ("zero", 1, "base", MOST_ODDS)
