"""`rig calibrate` beside plain least squares on arms of another generator: poses held out, and poses elsewhere."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from analysis import calibrate
from rigs.load import load
from tests.support.independent_arm import Array, Wrong, bad_arm, bad_zeros, cell, least_squares_fit, postures
from tests.support.pose_runs import pose_run

ZEROS, DH = "joint_offset", "joint_offset,link_geometry"
CORNER_DEG = (25, 12, 12, 30, 20, 60)
ARMS = ("paper-fanuc", "ur10e")
TESTED = 200
"""Poses by which both are judged."""


@dataclass(frozen=True)
class Trial:
    """What is wrong with the arms, what is fitted, and by which poses: how many, how far about the posture (deg; the
    whole arm where empty), and the share of wild ones."""

    what: str
    wrong: Callable[[np.random.Generator], Wrong]
    fit: str
    poses: int
    half_deg: tuple[float, ...] = ()
    wild: float = 0.0


TRIALS = (
    Trial("zeros off, zeros fitted, 30 poses", bad_zeros, ZEROS, 30),
    Trial("zeros off, 24 fitted, 30 poses", bad_zeros, DH, 30),
    Trial("all off, 24 fitted, 30 poses", bad_arm, DH, 30),
    Trial("zeros off, 24 fitted, 30 poses in a corner", bad_zeros, DH, 30, CORNER_DEG),
    Trial("all off, 24 fitted, 30 poses in a corner", bad_arm, DH, 30, CORNER_DEG),
    Trial("zeros off, 24 fitted, 12 poses", bad_zeros, DH, 12),
    Trial("all off, 24 fitted, 100 poses, 1 % wild", bad_arm, DH, 100, (), 0.01),
)


def main() -> int:
    parser = argparse.ArgumentParser(prog="scripts/dev transfer", description=__doc__)
    parser.add_argument("--seeds", type=int, default=4, help="of each arm and trial (4); a report has 20 and more")
    parser.add_argument("--first", type=int, default=0, help="the first seed (0)")
    given = parser.parse_args()
    print("| arms, rms in µm | nominal | least squares | rig | ratio | elsewhere: least squares | rig | ratio |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")
    for trial in TRIALS:
        rows = np.array([
            judged(trial, name, seed) for name in ARMS for seed in range(given.first, given.first + given.seeds)
        ])  # fmt: skip
        before, peer, ours, peer_far, ours_far = rows.T
        print(
            f"| {trial.what} | {np.median(before):.0f} | {np.median(peer):.0f} | {np.median(ours):.0f} | "
            f"{_ratio(ours, peer)} | {np.median(peer_far):.0f} | {np.median(ours_far):.0f} | "
            f"{_ratio(ours_far, peer_far)} |",
            flush=True,
        )
    return 0


def judged(trial: Trial, name: str, seed: int) -> tuple[float, ...]:
    """µm rms held out before, by least squares, by rig; elsewhere by both."""
    rng = np.random.default_rng(seed)
    arm = cell(name, trial.wrong(rng), rng)
    rig = load(name)[0].model_copy(update={"effects": ()})
    train = arm.seen(postures(name, trial.poses, rng, trial.half_deg), rng, wild=trial.wild)
    test, far = (arm.seen(postures(name, TESTED, rng, half), rng) for half in (trial.half_deg, ()))
    peer = least_squares_fit(arm.arm, train, trial.fit)
    runs = [pose_run(name, seen.q, seen.xyz_mm, *where) for seen, where in (
        (train, ("train",)), (test, ("test",)), (far, ("far", "elsewhere"))
    )]  # fmt: skip
    found = calibrate(runs[:1], trial.fit, rig=rig, hold_out=runs[1:2], unseen=runs[2:])
    assert found.held_out and found.unseen
    mm = (peer.held_out_mm(arm.arm, test, again=False), peer.held_out_mm(arm.arm, far, again=True))
    ours = (found.held_out.calibrated_um, found.unseen.calibrated_um)
    return (found.held_out.before_um, 1e3 * mm[0], ours[0], 1e3 * mm[1], ours[1])


def _ratio(ours: Array, peer: Array) -> str:
    return f"{np.median(ours / peer):.2f} (worst {np.max(ours / peer):.2f})"


if __name__ == "__main__":
    sys.exit(main())
