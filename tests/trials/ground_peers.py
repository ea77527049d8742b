"""Other programs in the proving ground: least squares, a Gaussian process, pybotics; nothing of rig is imported.

Each reads a directory of tasks (docs/how-to/enter-the-proving-ground.md) and writes its answers. Least squares (scipy)
fits a, alpha, d and zero of each axis, and frame and target of each placement; with gravity a compliance of each axis
as well. The Gaussian process (scikit-learn) predicts what constants leave, from sines and cosines of the joints.
pybotics fits the same constants by its own `optimize_accuracy`.
"""

from __future__ import annotations

import sys
import time
import warnings
from argparse import Namespace
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from pybotics.optimization import OptimizationHandler, optimize_accuracy
from pybotics.robot import Robot
from pybotics.tool import Tool
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

from tests.support.trial import Trial, main
from tests.trials.ground.plain_arm import (
    Array,
    Frame,
    PlainArm,
    Poses,
    framed,
    framed_at,
    read_arm,
    read_columns,
    read_poses,
    write_answer,
)

FITTED_BY_GP = 400
"""Poses at most by which the lengths of the kernel are chosen; the process itself has all of them."""
GIVEN_TO_PYBOTICS = 150
"""Poses at most, drawn once: it computes one posture at a time, and 1200 would take half an hour a task."""
STEP = 1e-4
"""Of numerical derivatives, in mm and mrad."""


Answer = tuple[Array, Array]
"""Places (m, 3) mm and u (m,) mm, nan where a program states none."""


@dataclass(frozen=True)
class Fitted:
    """An arm, the compliance of each axis (mrad/kNm) where `gravity`, and the frame of each placement, in one vector
    with its covariance, and what is left."""

    arm: PlainArm
    gravity: bool
    placements: tuple[str, ...]
    values: Array
    covariance: Array
    variance: float

    @property
    def of_arm(self) -> int:
        """Number of parameters of the arm."""
        return (5 if self.gravity else 4) * self.arm.axes

    def places(self, poses: Poses, values: Array | None = None) -> Array:
        """Places (m, 3) mm of poses of the placements that were fitted."""
        values = self.values if values is None else values
        constants, count = 4 * self.arm.axes, self.of_arm
        arm, found, q = self.arm.changed(values[:constants]), np.zeros((len(poses.q), 3)), poses.q
        if self.gravity:
            q = q + self.arm.torques(q) * values[constants:count] / 1e6
        for k, placement in enumerate(self.placements):
            there = poses.placement == placement
            found[there] = Frame(values[count + 9 * k : count + 9 * k + 9]).places(arm, q[there])
        return found

    def u(self, poses: Poses) -> Array:
        """Standard uncertainty (m,) in mm of the distance, from the fitted parameters and the residual."""
        columns = jacobian(lambda values: self.places(poses, values).ravel(), self.values).reshape(len(poses.q), 3, -1)
        own = np.einsum("mij,jk,mik->m", columns, self.covariance, columns)
        return np.sqrt(own + 3 * self.variance)

    def turns(self, poses: Poses) -> Array:
        """Rotation (m, 3, 3) from the base to the instrument of each pose."""
        found = np.tile(np.eye(3), (len(poses.q), 1, 1))
        for k, placement in enumerate(self.placements):
            turn = self.values[self.of_arm + 9 * k :][:3] / 1e3
            found[poses.placement == placement] = Rotation.from_rotvec(turn).as_matrix()
        return found


def jacobian(function: Callable[[Array], Array], at: Array) -> Array:
    """Return derivatives (n, p) of a function by central differences."""
    steps = STEP * np.eye(len(at))
    return np.stack([(function(at + step) - function(at - step)) / (2 * STEP) for step in steps], axis=1)


def fitted(arm: PlainArm, given: Poses, *, gravity: bool = False) -> Fitted:
    """Fit the constants of an arm, with or without compliance, and the frame of each placement by least squares."""
    placements = tuple(np.unique(given.placement))
    frames = [framed(arm, given.of(given.placement == placement)).values for placement in placements]
    start = np.concatenate([np.zeros((5 if gravity else 4) * arm.axes), *frames])
    empty = Fitted(arm, gravity, placements, start, np.zeros((0, 0)), 0.0)
    found = least_squares(lambda x: (empty.places(given, x) - given.xyz_mm).ravel(), start, method="trf")
    freedom = max(1, found.fun.size - np.linalg.matrix_rank(found.jac))
    variance = float(found.fun @ found.fun) / freedom
    covariance = variance * np.linalg.pinv(found.jac.T @ found.jac, rcond=1e-12)
    return Fitted(arm, gravity, placements, found.x, covariance, variance)


def by_constants(arm: PlainArm, given: Poses, asked: Poses, *, gravity: bool = False) -> Answer:
    """Answer by the constants, and by a compliance of each axis under the torque of the links."""
    found = fitted(arm, given, gravity=gravity)
    return found.places(asked), found.u(asked)


def by_gaussian_process(arm: PlainArm, given: Poses, asked: Poses) -> Answer:
    """Answer by the constants, and a process for what they leave, as the base of the robot sees it."""
    found = fitted(arm, given)
    left = np.einsum("mji,mj->mi", found.turns(given), given.xyz_mm - found.places(given))
    x, there = (np.hstack([np.cos(one.q), np.sin(one.q)]) for one in (given, asked))
    size = float(np.sqrt(np.mean(left**2)))
    kernel = ConstantKernel(1.0) * RBF(np.ones(x.shape[1]), (1e-2, 1e3)) + WhiteKernel(0.1, (1e-4, 10.0))
    chosen = np.random.default_rng(0).permutation(len(x))[:FITTED_BY_GP]
    tuned = GaussianProcessRegressor(kernel, random_state=0).fit(x[chosen], left[chosen] / size)
    process = GaussianProcessRegressor(tuned.kernel_, optimizer=None).fit(x, left / size)
    mean, sd = process.predict(there, return_std=True)
    more = np.einsum("mij,mj->mi", found.turns(asked), size * mean)
    return found.places(asked) + more, np.sqrt((size**2 * sd**2).sum(axis=1))


def by_pybotics(arm: PlainArm, given: Poses, asked: Poses) -> Answer:
    """Answer by pybotics: all constants, world frame and target. It knows one placement, that with most poses; those of
    others are fitted here to the arm that it found."""
    names, counts = np.unique(given.placement, return_counts=True)
    of_most = given.of(given.placement == names[counts.argmax()])
    chosen = np.isin(
        np.arange(len(of_most.q)), np.random.default_rng(0).permutation(len(of_most.q))[:GIVEN_TO_PYBOTICS]
    )
    used = of_most.of(chosen)
    frame = framed(arm, used).values
    world = np.eye(4)
    world[:3, :3], world[:3, 3] = Rotation.from_rotvec(frame[:3] / 1e3).as_matrix(), frame[3:6]
    constants = np.column_stack([arm.alpha, arm.a, arm.offset, arm.d])
    robot = Robot.from_parameters(constants)
    robot.world_frame, robot.tool = world, Tool()
    robot.tool.position = frame[6:]
    handler = OptimizationHandler(robot, True, [True] * 3 + [False] * 3, True)
    found = least_squares(
        optimize_accuracy, handler.generate_optimization_vector(), args=(handler, used.q, used.xyz_mm), x_scale="jac",
        max_nfev=30,
    )  # fmt: skip
    handler.apply_optimization_vector(found.x)
    robot = handler.robot
    said = np.array([robot.fk(q)[:3, 3] for q in asked.q])
    robot.world_frame, robot.tool = np.eye(4), Tool()

    def flange(q: Array) -> tuple[Array, Array]:
        T = np.array([robot.fk(one) for one in q])
        return T[:, :3, :3], T[:, :3, 3]

    for placement in np.unique(asked.placement[asked.placement != names[counts.argmax()]]):
        new, there = given.of(given.placement == placement), asked.placement == placement
        said[there] = framed_at(*flange(new.q), new.xyz_mm).seen(*flange(asked.q[there]))
    return said, np.full(len(said), np.nan)


ENTRIES: dict[str, Callable[[PlainArm, Poses, Poses], Answer]] = {
    "least-squares": by_constants,
    "with-gravity": partial(by_constants, gravity=True),
    "gaussian-process": by_gaussian_process,
    "pybotics": by_pybotics,
}


def draw(given: Namespace) -> Iterator[tuple[str, Path, Path]]:
    """Entry, task and answer of every task."""
    for name in read_columns(given.tasks / "tasks.csv")["name"]:
        yield given.entry, given.tasks / str(name), given.answers / f"{name}.csv"


def answered(case: tuple[str, Path, Path]) -> str:
    entry, here, path = case
    warnings.simplefilter("ignore", ConvergenceWarning)  # lengths at a bound: the joint does not matter
    begin = time.process_time()
    poses = (read_poses(here / f"{one}.csv") for one in ("train", "test"))
    write_answer(path, *ENTRIES[entry](read_arm(here / "arm.csv"), *poses))
    return f"{entry}: {here.name}, {time.process_time() - begin:.1f} s"


TRIAL = Trial(
    draw,
    answered,
    options={
        "ENTRY": (str, "which program answers", ENTRIES),
        "TASKS": (Path, "the directory of tasks.csv"),
        "ANSWERS": (Path, "where the answers go"),
    },
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
