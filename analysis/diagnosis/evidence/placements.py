"""Placements: runs that share a set-up.

Runs with the same test and placement share a set-up unless their readings show a move. Model errors displace the balls
of circles of the same direction equally, so balls further apart than the scatter of a real cell were mounted
separately. Backlash shifts the ball of the other direction, so frames of both are only matched. Runs at targets, and
poses, that cannot share a rigid frame have much larger residuals together than separately. Poses of all placements
share the target on the tool; the data can prove that a reflector was moved.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from analysis.diagnosis.evidence.observation import (
    ObservedRun,
    observe,
    predicted,
    residual_of,
    rms,
    thinned,
    with_placement,
    without_socket,
)
from analysis.diagnosis.evidence.setups import FRAME, fit_setups, placement_of, target_of, targeted
from analysis.robot.kinematics.arm import Arm, Array, arm_of
from analysis.robot.predict import SetUps, model_of
from analysis.runs.loading import Measured
from analysis.runs.noise.cell_noise import BALL_MM, JOINT_DEG
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.text import counted

_NEEDS = {"touch": ("touch", "touches", "its socket"), "pose": ("pose", "poses", "base and target")}
"""Readings of a test, and what the first of them determine."""
_APART = 3.0
"""Ratio of the common residual of two runs to the separate residuals, above which they have separate frames. Chosen."""
_APART_MM = 5 * BALL_MM.high
"""Minimum difference between the common and the separate residuals: five times the largest scatter of a ball in real
cells.
"""
_MOVED_MM = 3 * float(np.hypot(BALL_MM.high, 1000 * np.radians(JOINT_DEG.high)))
"""Change of the readings between repeated circles above which the ball was moved: three times the largest scatter of
ball and joints of real cells, at a metre.
"""
TO_SPARE = 9
"""Surplus of readings over set-up terms required for a meaningful residual of a single run. Chosen: three poses."""


def observe_runs(rig: Rig, runs: Sequence[Measured]) -> list[ObservedRun]:
    """Observe runs with the set-up of their placement. Raises FileError for a run of a different robot."""
    model = model_of(rig)
    for run in runs:
        if not same_arm(arm_of(run.rig.robot), model.arm):
            problem = f"belongs to a different robot than {rig.name}: the link constants differ"
            raise FileError(
                str(run.path),
                problem,
                "give runs of a single robot, or the original rig file with --rig",
                code="robot.other",
            )
    return [with_placement(observe(model, run.table, str(run.path)), run.run.manifest.placement) for run in runs]


def split_by_frame(runs: Sequence[ObservedRun], names: Sequence[str]) -> tuple[list[ObservedRun], list[str]]:
    """Give runs a set-up for each visible frame, with messages; for poses see `split_by_target`."""
    split_up, messages = list(runs), []
    for setup in dict.fromkeys(run.setup for run in runs):
        places = [k for k, run in enumerate(runs) if run.setup == setup]
        if runs[places[0]].table.swept:
            split = _circle_frames(runs, places)
        else:  # most readings first, because a run of few readings can only join a frame
            places.sort(key=lambda k: -runs[k].values.size)
            split = _grouped(places, lambda frame, k: _shares_frame([runs[j] for j in frame], [runs[k]])[1])
        frames = sorted(map(sorted, split))
        for number, frame in enumerate(frames[1:], start=2):
            for k in frame:
                split_up[k] = replace(split_up[k], setup=f"{setup}{FRAME}{number}")
        if len(frames) > 1 and not runs[places[0]].facts.of_tracker:
            messages.append(_of_frames(setup, [[names[k] for k in frame] for frame in frames]))
    return split_up, messages


def _of_frames(setup: str, frames: Sequence[Sequence[str]]) -> str:
    runs = "; ".join(", ".join(names) for names in frames)
    message = f"the {setup} runs do not share a frame, so they were fitted as {len(frames)} placements ({runs})"
    return f"{message}; rig relabel --placement can name them"


def split_by_target(runs: Sequence[ObservedRun], names: Sequence[str]) -> tuple[list[ObservedRun], list[str]]:
    """Give poses a separate target for each visible tool position, with messages. A reflector moved under a stationary
    instrument keeps the frame of that placement.
    """
    split_up = list(runs)
    members: dict[str, list[int]] = {}
    for k, run in enumerate(runs):
        if run.facts.of_tracker:
            members.setdefault(run.setup, []).append(k)
    settled: dict[str, list[ObservedRun]] = {}
    for setup in sorted(members, key=lambda name: -_readings(runs, name)):
        of_setup = [runs[k] for k in members[setup]]
        name = _settled(settled, setup, of_setup)
        settled[name] = [replace(run, setup=name) for run in of_setup]
        for k, run in zip(members[setup], settled[name], strict=True):
            split_up[k] = run
    named = {split_up[places[0]].setup: [names[k] for k in places] for places in members.values()}
    if any(map(target_of, named)):
        targets: dict[str, list[str]] = {}
        for setup, its_names in named.items():
            targets.setdefault(target_of(setup), []).extend(its_names)
        of_runs = "; ".join(", ".join(its_names) for _, its_names in sorted(targets.items()))
        count = len({placement_of(setup) for setup in named})
        stood = "one place of the instrument" if count == 1 else f"{count} places of the instrument"
        message = f"the poses show {len(targets)} places of the target on the tool ({of_runs}) and {stood}: each "
        return split_up, [message + "was fitted as a separate set-up of one arm, as for several reflectors"]
    frames: dict[str, list[list[str]]] = {}
    for setup, its_names in sorted(named.items()):
        frames.setdefault(setup.partition(FRAME)[0], []).append(its_names)
    return split_up, [_of_frames(setup, members) for setup, members in frames.items() if len(members) > 1]


def _settled(settled: dict[str, list[ObservedRun]], setup: str, runs: Sequence[ObservedRun]) -> str:
    """Name of the set-up of runs: with the target or the frame of one determined so far, or new."""
    if not settled:
        return setup
    targets = list(dict.fromkeys(map(target_of, settled)))
    trials = {targeted(setup, target): [home for home in settled if target_of(home) == target] for target in targets}
    frame = setup.partition(FRAME)[0]
    if frame != setup:
        trials[targeted(frame, str(len(targets) + 1))] = [home for home in settled if placement_of(home) == frame]
    # Few poses are not judged: they take the common target.
    few, fits = sum(run.values.size for run in runs) < runs[0].facts.setup_terms + TO_SPARE, []
    for name, homes in trials.items():
        if homes:
            moved_mm, is_home = _shares_frame(settled[homes[0]], [replace(run, setup=name) for run in runs])
            fits += [(moved_mm, name)] * (target_of(name) == target_of(homes[0]) if few else is_home)
    return min(fits)[1] if fits else targeted(setup, str(len(targets) + 1))


def with_enough_readings(runs: Sequence[ObservedRun]) -> tuple[list[int], list[str]]:
    """Indices of runs whose readings determine their set-ups, and messages about the others. Raises FileError if no run
    remains.
    """
    tool_known = {
        (run.table.test, target_of(run.setup)) for run in runs if _readings(runs, run.setup) > run.facts.setup_terms
    }
    reasons: dict[str, str] = {}
    for run in runs:
        shares = run.facts.of_places and (run.table.test, target_of(run.setup)) in tool_known
        terms = run.facts.setup_terms - 3 * shares
        readings = _readings(runs, run.setup)
        if readings <= terms:
            noun, plural, needs = _NEEDS.get(run.table.test, ("reading", "readings", "the set-up"))
            count = counted(readings // 3 if run.facts.of_places else readings, noun, plural)
            reasons[run.setup] = f"has only {count}, no more than the fit of {needs} needs"
    kept = [k for k, run in enumerate(runs) if run.setup not in reasons]
    if not kept:
        setup, why = next(iter(reasons.items()))
        raise FileError(
            f"set-up {setup}",
            why,
            "measure in more postures",
            code="readings.too_few",
        )
    return kept, [f"{setup} is ignored, because it {why}" for setup, why in reasons.items()]


def reach_mm(judged: SetUps, used: SetUps) -> float:
    """Largest distance (mm) of a validated socket from all used sockets of other placements, or of all others for a
    single placement. Errors of an arm further away are invisible, and reached four u for real arms.
    """
    several = len({without_socket(name) for name in used}) > 1
    place = {name: setup.T_instrument_world[:3, 3] for name, setup in judged.items()}

    def nearest(name: str) -> float:
        apart = (other for other in used if other != name)
        others = [other for other in apart if not several or without_socket(other) != without_socket(name)]
        return min((float(np.linalg.norm(place[name] - place[other])) for other in others), default=0.0)

    return max(map(nearest, judged))


def same_arm(first: Arm, second: Arm) -> bool:
    rail, other_rail = (np.zeros(3) if arm.rail is None else arm.rail for arm in (first, second))
    return np.allclose(rail, other_rail, atol=1e-9) and all(
        np.allclose(getattr(first, constant), getattr(second, constant), atol=1e-9)
        for constant in ("a", "alpha", "beta", "d", "offset", "coupling", "to_drives")
    )


def _readings(runs: Sequence[ObservedRun], setup: str) -> int:
    return sum(run.values.size for run in runs if run.setup == setup)


def _circle_frames(runs: Sequence[ObservedRun], places: Sequence[int]) -> list[list[int]]:
    few = {k: thinned(runs[k]) for k in places}
    placed = {k: fit_setups([run])[run.setup] for k, run in few.items()}

    def moved_mm(first: int, second: int) -> float:
        at_first, at_second = (predicted(few[second], placed[k]) for k in (first, second))
        return rms([at_second - at_first])

    ways: dict[str, list[int]] = {}
    for k in places:
        ways.setdefault(runs[k].table.driven_direction or "", []).append(k)
    by_way = [_grouped(of_way, lambda frame, k: moved_mm(frame[0], k) < _MOVED_MM) for of_way in ways.values()]
    most, *others = sorted(by_way, key=len, reverse=True)
    for frames in others:
        if len(most) == 1:
            most[0] += frames[0]
            continue
        from scipy.optimize import linear_sum_assignment  # noqa: PLC0415 - slow to import, needed here only

        # Each frame is assigned once, minimising the sum of distances.
        apart = np.array([[moved_mm(home[0], frame[0]) for home in most] for frame in frames])
        for row, column in zip(*linear_sum_assignment(apart), strict=True):
            most[column] += frames[row]
    return most


def _grouped(places: Sequence[int], is_home: Callable[[list[int], int], bool]) -> list[list[int]]:
    """Group runs: each joins the first frame that `is_home` accepts for it, or starts a new frame."""
    frames: list[list[int]] = []
    for k in places:
        home = next((frame for frame in frames if is_home(frame, k)), None)
        if home is None:
            frames.append([k])
        else:
            home.append(k)
    return frames


def _shares_frame(home: Sequence[ObservedRun], runs: Sequence[ObservedRun]) -> tuple[float, bool]:
    """Residual in mm of runs and others in a common set-up, and whether it is hardly larger than in separate set-ups.
    Runs of few readings have no residual of their own, so the others decide.
    """
    together = _residuals([*home, *runs])
    together_mm = max(rms(together[: len(home)]), rms(together[len(home) :]))
    is_enough = sum(run.values.size for run in runs) >= runs[0].facts.setup_terms + TO_SPARE
    alone_mm = max(rms(_residuals(each)) for each in ((home, runs) if is_enough else (home,)))
    return together_mm, together_mm < max(_APART * alone_mm, alone_mm + _APART_MM)


def _residuals(runs: Sequence[ObservedRun]) -> list[Array]:
    setups = fit_setups(runs)
    return [residual_of(run, setups) for run in runs]
