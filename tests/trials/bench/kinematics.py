"""The rows of kinematics: forward, inverse with all branches, and along a path."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from analysis.robot.kinematics.arm import Array, forward
from analysis.robot.kinematics.follow import follow
from analysis.robot.kinematics.inverse import inverse
from tests.support.benchmarks import Line, Peer, beside
from tests.support.five_arms import ARMS, calibrated
from tests.support.postures import random_angles
from tests.trials.bench.bench_peers import (
    eaik_branches,
    opw_along,
    opw_branches,
    opw_forward,
    pinocchio_along,
    toolbox_one,
)

ELBOW, UR = "ABB IRB 2400/10", "ur10e"
START = np.radians([10.0, 40, -20, 30, 50, 20])
SEED = 2026


def forward_lines() -> Iterator[Line]:
    """Forward kinematics by the number of poses."""
    for count in (1_000, 10_000, 100_000, 1_000_000):
        q = random_angles(SEED, count)
        yield _line("forward", ELBOW, count, 0.4, lambda q=q: forward(ARMS[ELBOW], q), opw_forward(ELBOW, q))


def inverse_lines() -> Iterator[Line]:
    """All branches of ideal arms."""
    count = 10_000
    for name in (ELBOW, UR):
        T = forward(ARMS[name], random_angles(SEED, count))
        peers = [eaik_branches(ARMS[name], T)] + ([opw_branches(name, T)] if name == ELBOW else [])
        for peer in peers:
            yield _line("inverse", name, count, 4.0, lambda name=name, T=T: inverse(ARMS[name], T), peer)


def calibrated_lines() -> Iterator[Line]:
    """Measure all branches of arms with slightly wrong constants, for which no closed form exists."""
    count = 1_000
    for name in (ELBOW, UR):
        arm = calibrated(ARMS[name], SEED)
        T = forward(arm, random_angles(SEED, count))
        yield _line("calibrated", name, count, 60.0, lambda arm=arm, T=T: inverse(arm, T), toolbox_one(arm, T))


def path_lines() -> Iterator[Line]:
    """Along a smooth path that turns every joint, ideal and calibrated."""
    free = replace(ARMS[ELBOW], limits=np.tile([-7.0, 7.0], (6, 1)))
    for count in (1_000, 100_000):
        for arm, what, goal in ((free, ELBOW, 5.0), (calibrated(free, SEED), f"{ELBOW} calibrated", 8.0)):
            T = forward(arm, smooth_path(count))
            peer = opw_along(ELBOW, T, START) if arm is free else pinocchio_along(arm, T, START)
            yield _line("path", what, count, goal, lambda arm=arm, T=T: follow(arm, T, START, "path"), peer)


def smooth_path(count: int) -> Array:
    """Joint angles (count, 6) rad that swing by up to 25° about the start, each joint at a pace of its own."""
    s = np.linspace(0, 1, count)[:, None]
    return START + np.radians(25) * np.sin(2 * np.pi * s * np.array([1, 0.7, 0.5, 1.2, 0.4, 1.5]))


def _line(row: str, what: str, count: int, goal: float, ours: Callable[[], object], peer: Peer) -> Line:
    figures = beside(ours, peer, count)
    name = f"{peer.name} ({peer.missing})" if peer.missing else peer.name
    return Line(row, f"{what}, {count:.0e} poses".replace("e+0", "e"), "µs a pose", goal, figures[0], name, figures[1])
