"""Arms of other numbers of axes, of another generator: what poses, or touches, name and leave, beside least squares.

`scripts/dev seven_axes --cases 20` draws arms with one or two faults and 200 poses of a tracker; `--sockets 1 2 4` has
40 touches instead. Printed: faults named as they were hidden, sizes within 2 u, names of what was not hidden, and the
error at 200 postures that were not used, of the nominal arm, of least squares of all constants, and calibrated.
"""

from __future__ import annotations

import sys
import time
from argparse import Namespace
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from analysis.diagnosis.diagnose import diagnose
from analysis.diagnosis.judge.result import Diagnosis
from analysis.procedures.shared.test_kind import path_of
from analysis.robot.geometry.pose_setup import fit_setup, position_error
from analysis.robot.kinematics.arm import Array
from analysis.robot.model.predict import Model, model_of, moved
from analysis.runs.loading import Measured
from analysis.runs.tables import PoseTable, TouchTable
from rigs.arms import load_arm
from rigs.effects import Effect, changed, turned
from rigs.load import parse
from rigs.rig import Rig
from rigs.schema.declared_tests import KnownSocketDistance
from rigs.schema.effect import name_of, size_field
from rigs.schema.vocabulary import DRIVEN_AXES
from tests.support.trial import Trial, main, seeds
from tests.worlds.arms.seven_axes import (
    Fault,
    Truth,
    draw_faults,
    draw_postures,
    draw_truth,
    pose_table,
    reach_mm,
    run_of,
    somewhere,
    touch_table,
)

POSES, TOUCHES, UNSEEN = 200, 40, 200
BALL_MM = np.array([10.0, -5.0, 120.0])
ASIDE_MM = 30.0
"""How far beside the last axis the ball of an arm of few axes is: on it, that axis would hold the ball still."""
_STEPS, _STEP, _SHOWN, _LONGEST = 5, 1e-3, 1e-3, 4.9
"""Least squares: steps, the step of the slopes (mm and degrees), the singular value below which nothing is moved, as a
share of the largest, and the longest step."""
_SEEN_MM = 0.1
"""Scatter of a touch that weighs a known distance against them."""


@dataclass(frozen=True)
class Case:
    """One arm: hidden faults, found effects, and the errors (mm rms) at places that were not used."""

    seed: int
    sockets: int
    hidden: tuple[Fault, ...]
    truth: Truth
    found: Diagnosis
    nominal_mm: float
    squares_mm: float
    calibrated_mm: float
    seconds: float


def draw(given: Namespace) -> Iterator[Namespace]:
    """Each seed of each number of sockets with the options."""
    for sockets in given.sockets or [0]:
        yield from (Namespace(**vars(given) | {"seed": seed, "sockets": sockets}) for seed in seeds(given))


def drawn(case: Namespace) -> Case:
    """One arm, measured and diagnosed."""
    name, seed, sockets, play_deg = case.arm, case.seed, case.sockets, case.play
    known_mm, bars_mm = case.known_mm, case.bars
    rng = np.random.default_rng([7, seed])
    rig = _rig(name, max(sockets, 1))
    faults = (
        draw_faults(rig.robot, rng, int(rng.integers(1, 3)))
        if play_deg is None
        else (Fault("play", int(rng.integers(1, len(rig.robot.axes))), play_deg),)
    )
    truth = draw_truth(rig.robot, rng, faults)
    ball = _ball_mm(rig)
    places: Array | int = sockets
    if sockets > 1 and known_mm is not None:
        reach = reach_mm(rig.robot)
        places = _bars(rng, reach, bars_mm) if bars_mm else np.array([somewhere(rng, reach) for _ in range(sockets)])
        known = [
            KnownSocketDistance(
                between=("ABCD"[first], "ABCD"[first + 1]),
                distance_mm=float(np.linalg.norm(places[first + 1] - places[first])) + float(rng.normal(0, known_mm)),
                u_mm=known_mm,
            )
            for first in ((0, 2) if bars_mm else (0,))
        ]
        rig = _rig(name, sockets, *known)
    table = (
        touch_table(rig.robot, truth, rng, ball, places, TOUCHES)
        if sockets
        else pose_table(rig.robot, truth, rng, ball, POSES)
    )
    run = run_of(rig, table)
    start = time.process_time()
    found = diagnose(rig, [run], [], [], lambda _: None)
    seconds = time.process_time() - start
    effects = [one.effect for one in found.written]
    effects += found.calibrated.effects if found.calibrated else ()
    errors = [_unseen_mm(rig, truth, own, seed) for own in ([], _squares(rig, run), effects)]
    return Case(seed, sockets, faults, truth, found, *errors, seconds)


def _bars(rng: np.random.Generator, reach: float, length_mm: float) -> Array:
    """Places (4, 3) mm of the sockets of two bars that lie level and across the reach, one low and one high."""
    ends = []
    for away, high in ((0.55, 0.07), (0.45, 0.6)):
        around = rng.uniform(-1.2, 1.2)
        outwards, across = (
            np.array([np.cos(around), np.sin(around), 0.0]),
            np.array([-np.sin(around), np.cos(around), 0.0]),
        )
        middle = reach * (away * outwards + [0.0, 0.0, high])
        ends += [middle - length_mm / 2 * across, middle + length_mm / 2 * across]
    return np.array(ends)


def _ball_mm(rig: Rig) -> Array:
    """Where the ball (3,) mm is on the flange."""
    few = len(rig.robot.axes) < DRIVEN_AXES
    return np.array([ASIDE_MM, BALL_MM[1], BALL_MM[2]]) if few else BALL_MM


def _rig(name: str, sockets: int, *distances: KnownSocketDistance) -> Rig:
    names = ", ".join(f'"{letter}"' for letter in "ABCD"[:sockets])
    stated = f", distances: [{', '.join(known.model_dump_json() for known in distances)}]" if distances else ""
    return parse(f"name: seven\n{load_arm(name).text}tests: {{touch: {{sockets: [{names}]{stated}}}}}\n", "seven.yaml")


def _unseen_mm(rig: Rig, truth: Truth, effects: list[Effect], seed: int) -> float:
    """How far a model is from the arm at postures that were not used, rms mm, with base and ball fitted."""
    rng = np.random.default_rng([8, seed])
    q = draw_postures(rig.robot, rng, UNSEEN)
    really = truth.places(q, np.vstack([q[:1], q[:-1]]), _ball_mm(rig))
    T = _posed(model_of(rig, effects), PoseTable(q, really, None))
    return float(np.sqrt(np.mean(np.sum(position_error(T, really, fit_setup(T, really)) ** 2, axis=1))))


def _posed(model: Model, table: PoseTable | TouchTable) -> Array:
    return moved(model, path_of(model, table)).T


def _squares(rig: Rig, run: Measured) -> list[Effect]:
    """A least-squares fit of all zeros, lengths and twists with the set-up, as in an ordinary calibration, by
    singular values; barely visible combinations stay zero.
    """
    table = run.table
    assert isinstance(table, PoseTable | TouchTable)
    axes = len(rig.robot.axes)
    kinds = [(key, axis) for axis in range(1, axes + 1) for key in ("q_deg", "a_mm", "alpha_deg", "d_mm")]

    def effects(x: Array) -> list[Effect]:
        return [
            turned(axis, float(one)) if key == "q_deg" else changed(axis, key, float(one))
            for (key, axis), one in zip(kinds, x, strict=True)
        ]

    names = np.unique(table.socket, return_inverse=True)[1] if isinstance(table, TouchTable) else None

    def left(x: Array) -> Array:
        own, ball = x[: len(kinds)], x[len(kinds) : len(kinds) + 3]
        T = _posed(model_of(rig, effects(own)), table)
        places = T[:, :3, 3] + T[:, :3, :3] @ (_ball_mm(rig) + ball)
        if names is None:
            a, b = places - places.mean(axis=0), table.xyz_mm - table.xyz_mm.mean(axis=0)
            u, _, v = np.linalg.svd(a.T @ b)
            off = a @ (u @ np.diag([1, 1, np.linalg.det(u @ v)]) @ v) - b
        else:
            means = np.array([places[names == k].mean(axis=0) for k in range(names.max() + 1)])
            off = places - means[names]
            for stated in rig.tests.touch.distances if rig.tests.touch else ():
                first, second = (means["ABCD".index(socket)] for socket in stated.between)
                off_mm = np.linalg.norm(second - first) - stated.distance_mm
                off = np.vstack([off, [off_mm / stated.u_mm * _SEEN_MM, 0, 0]])
        return np.asarray(off.ravel())

    x = np.zeros(len(kinds) + 3)
    for _ in range(_STEPS):
        here = left(x)
        J = np.stack([(left(x + step) - here) / _STEP for step in _STEP * np.eye(len(x))], axis=1)
        x -= np.clip(np.linalg.lstsq(J, here, rcond=_SHOWN)[0], -_LONGEST, _LONGEST)
        x[: len(kinds)] = np.clip(x[: len(kinds)], -_LONGEST, _LONGEST)
    return effects(x[: len(kinds)])


def _line(case: Case) -> str:
    found = case.found
    named = ", ".join(
        f"{name_of(one.effect)} {getattr(one.effect, key):.4g}±{one.sd.get(key, 0):.2g}"
        for one in found.standing
        for key in [size_field(one.effect)]
    )
    hidden = ", ".join(f"{fault.name} {case.truth.size_of(fault):.4g}" for fault in case.hidden)
    errors = f"{case.nominal_mm:.3f} {case.squares_mm:.3f} {case.calibrated_mm:.3f}"
    head = f"{case.seed:4d}  {errors} mm  {case.seconds:5.1f} s  {found.condition:16s}"
    return f"{head} hidden {hidden}; named {named or '-'}"


def report(cases: Sequence[Case]) -> str:
    kinds = dict.fromkeys(case.sockets for case in cases)
    return "\n".join(_summary(kind, [case for case in cases if case.sockets == kind]) for kind in kinds)


def _summary(sockets: int, cases: list[Case]) -> str:
    hidden = named = within = others = 0
    listed = undecided = 0
    for case in cases:
        own = {name_of(one.effect): one for one in case.found.standing}
        for fault in case.hidden:
            hidden += 1
            one = own.get(fault.name)
            rivals = {name_of(r.effect) for every in case.found.standing for r in every.rivals}
            listed += one is None and fault.name in rivals
            undecided += one is None and fault.name in {name_of(every.effect) for every in case.found.effects}
            if one:
                named += 1
                key = size_field(one.effect)
                within += abs(getattr(one.effect, key) - case.truth.size_of(fault)) <= 2 * max(
                    one.sd.get(key, 0.0), 1e-12
                )
        others += sum(name not in {fault.name for fault in case.hidden} for name in own)
    rms = [
        float(np.sqrt(np.mean([getattr(case, key) ** 2 for case in cases])))
        for key in ("nominal_mm", "squares_mm", "calibrated_mm")
    ]
    what = f"{TOUCHES} touches of {sockets} socket(s)" if sockets else f"{POSES} poses"
    return (
        f"{what}, {len(cases)} arms: {named} of {hidden} faults named ({listed} more among rivals, "
        f"{undecided} with a size but undecided), {within} of {named} sizes within 2 u, "
        f"{others} other names; unseen {rms[0]:.3f} nominal, {rms[1]:.3f} least squares, "
        f"{rms[2]:.3f} mm calibrated; {np.mean([case.seconds for case in cases]):.1f} s of CPU each"
    )


TRIAL = Trial(
    draw,
    drawn,
    report,
    line=_line,
    count=4,
    options={
        "arm": ("franka-fr3", "an arm of the library (franka-fr3)"),
        "sockets": ([0], "touches of so many sockets; 0: poses (0)"),
        "known_mm": (float, "the distance of the first two sockets is known to so many mm"),
        "bars": (float, "with --known-mm: two bars of so many mm across, one low, one high"),
        "play": (float, "hide a play of so many degrees, and nothing else"),
    },
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
