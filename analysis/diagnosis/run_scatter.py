"""The scatter of joints and ball between runs, which moves all readings of a run together.

The geometry of the arm determines how the readings change. A part of the scatter is constant in a run; the rest drifts
along it, as encoders and temperature do, in a few waves of unknown phase. Repeated runs determine both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, dataclass, replace

import numpy as np

from analysis.fitting.observation import Observation, predicted, predicted_in_scene
from analysis.kinematics.arm import Array
from analysis.model.predict import Model, SetUp, moved
from analysis.noise.cell import BALL_MM, JOINT_DEG
from analysis.traces.tables import PoseTable
from rigs.effects import turned

SCATTER_DEG, SCATTER_MM = 0.0002, 0.001
"""The unit of scatter of joints and ball to which `scatter_response` refers; all scatter is a multiple of it. It has no
effect on the result."""
_MULTIPLES = np.array([0.0, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0])
"""Scatter that is tried, in these units; the largest exceeds that of real cells, 0.005° and 20 µm. Chosen: factors of
two, since few repeats do not separate closer ones and their average is used."""
DRIFTING_SHARE = 0.5
"""Share of the energy of a run's scatter that drifts along the run, where nothing is measured: encoders and warming
move joints and ball smoothly. Chosen: one half."""
_SHARES = np.array([0.0, 0.3, 0.6, 0.9])
"""Shares that are tried where repeats determine it. Chosen: a few runs do not separate closer ones."""
_OWN = (slice(0, 6), slice(6, 9))
"""The columns of a response that belong to the joints, and to the ball."""
_DRIFT_ORDERS = 3
"""Orders of the drift, in cycles per run. Chosen: slower than any joint motion of a circle."""
_SEEN = 0.1
"""Size in standard deviations of the noise below which a combination of scattered terms is ignored. Chosen: it changes
a variance by one hundredth."""


@dataclass(frozen=True)
class RunScatter:
    """Scatter of the joints and of the ball between runs, in the units of `scatter_response`: the part that is constant
    in a run, and the part that drifts along it."""

    joints: float
    ball: float
    drifting_joints: float
    drifting_ball: float

    def constant(self, terms: int) -> Array:
        """Return the constant scatter (terms,), relative to its unit, of the six joints and then of the ball, if it is
        included."""
        return np.array([self.joints] * 6 + [self.ball] * 3)[:terms]

    def drifting(self, terms: int) -> Array:
        """Return the drifting scatter (terms,), relative to its unit, in the same order."""
        return np.array([self.drifting_joints] * 6 + [self.drifting_ball] * 3)[:terms]


ASSUMED_SCATTER = RunScatter(
    JOINT_DEG.rms / SCATTER_DEG,
    BALL_MM.rms / SCATTER_MM,
    float(np.sqrt(DRIFTING_SHARE)) * JOINT_DEG.rms / SCATTER_DEG,
    float(np.sqrt(DRIFTING_SHARE)) * BALL_MM.rms / SCATTER_MM,
)
"""The scatter of real cells."""


def average_scatter(every: Sequence[RunScatter]) -> RunScatter:
    """Return the root mean square of some scatters."""
    return RunScatter(*np.sqrt(np.mean(np.array([astuple(one) for one in every]) ** 2, axis=0)).tolist())


def scatter_response(model: Model, one: Observation, setup: SetUp) -> Array:
    """Return the response of the readings, (m, k, 9) mm, to a unit scatter of each joint and of the ball; for poses,
    whose instrument frame is always fitted, of the joints alone, (m, 3, 6)."""
    scene = moved(model, one.path)
    base = predicted_in_scene(model, one, scene, setup)
    columns = []
    for axis in range(1, 7):
        off = replace(model, effects=(*model.effects, turned(axis, SCATTER_DEG)))
        columns.append(predicted(off, one, setup) - base)
    if not isinstance(one.table, PoseTable):
        steps = SCATTER_MM * np.eye(3)
        columns += [
            predicted_in_scene(model, one, scene, replace(setup, ball=setup.ball + step)) - base for step in steps
        ]
    return np.stack(columns, axis=2)


def drift_waves(share: Array) -> Array:
    """Return the waves (w, m) of a unit scatter that drifts along the run, at the share (m,) of its duration."""
    turns = 2 * np.pi * np.arange(1, _DRIFT_ORDERS + 1)[:, None] * share
    waves: Array = np.concatenate([np.cos(turns), np.sin(turns)]) / np.sqrt(_DRIFT_ORDERS)
    return waves


@dataclass(frozen=True)
class ScatteredRuns:
    """Deviations `apart` (n, N) mm of n runs from their mean, and their responses to a unit scatter: `constant`
    (N, 9) mm and `drifting` (w, N, 9) mm. `stamps` (N, s) mm is what one standard deviation of the scatter of stamps
    adds at a few angles."""

    apart: Array
    constant: Array
    drifting: Array
    stamps: Array

    def noise(self, scatter: RunScatter, sd_mm: Array) -> tuple[Array, Array]:
        """Return the part (n, N) mm of the deviations that is expected to be noise of sd_mm (N,) and not scatter, and
        the share (N,) of the noise that this part contains."""
        columns, taken = self._regression(scatter, sd_mm)
        noise: Array = self.apart - (self.apart / sd_mm) @ taken.T @ columns.T * sd_mm
        return noise, 1 - np.einsum("nc,cn->n", columns, taken)

    def without_stamps(self, scatter: RunScatter, sd_mm: Array) -> Array:
        """Return the deviations (n, N) mm without what stamps are expected to have added, given noise of sd_mm (N,)."""
        if not self.stamps.size:
            return self.apart
        _, taken = self._regression(scatter, sd_mm)
        stamps = taken[taken.shape[0] - self.stamps.shape[1] :]
        left: Array = self.apart - (self.apart / sd_mm) @ stamps.T @ self.stamps.T
        return left

    def _regression(self, scatter: RunScatter, sd_mm: Array) -> tuple[Array, Array]:
        """Return what one standard deviation of scatter and of stamps adds, (N, c) in those of the noise sd_mm (N,),
        and the matrix (c, N) that estimates their coefficients from readings in the same unit."""
        scattered = scatter_columns(self.constant, self.drifting, scatter)
        columns = np.concatenate([scattered, self.stamps], axis=1) / sd_mm[:, None]
        normal = columns.T @ columns
        normal[np.diag_indices_from(normal)] += 1.0
        return columns, np.asarray(np.linalg.solve(normal, columns.T), dtype=float)

    def whitened(self, sd_mm: Array) -> ScatteredRuns:
        """Return the same runs in standard deviations of noise of sd_mm (N,) and of stamps together, instead of mm."""
        left, size, _ = np.linalg.svd(self.stamps / sd_mm[:, None], full_matrices=False)
        less = left * (1 - 1 / np.sqrt(1 + size**2))

        def white(rows: Array) -> Array:
            own = rows / sd_mm
            found: Array = own - (own @ left) @ less.T
            return found

        drifting = white(self.drifting.swapaxes(1, 2)).swapaxes(1, 2)
        return ScatteredRuns(white(self.apart), white(self.constant.T).T, drifting, self.stamps[:, :0])


def scatter_columns(constant: Array, drifting: Array, scatter: RunScatter) -> Array:
    """Return what one standard deviation of scatter adds, (N, c + c w) mm, given its constant (N, c) and its drifting
    response (w, N, c) mm."""
    terms = constant.shape[1]
    return np.concatenate([constant * scatter.constant(terms), *(drifting * scatter.drifting(terms))], axis=1)


def without_unseen(columns: Array, sd_mm: Array) -> Array:
    """Return columns (N, r) mm with the same covariance as columns (N, c), without what is far below the noise sd_mm
    (N,)."""
    left, size, _ = np.linalg.svd(columns / sd_mm[:, None], full_matrices=False)
    seen = size > _SEEN
    found: Array = left[:, seen] * size[seen] * sd_mm[:, None]
    return found


def unscattered(apart: Array, columns: Array) -> tuple[Array, Array]:
    """Return the part (n, N) mm of deviations (n, N) mm that columns (N, c) cannot explain, and the share (N,) of the
    noise that this part contains."""
    span = _span_of(columns)
    return apart - (apart @ span) @ span.T, 1 - (span**2).sum(axis=1)


def _span_of(columns: Array) -> Array:
    """Return an orthonormal basis of columns (N, c), without directions that are nearly zero."""
    squares, directions = np.linalg.eigh(columns.T @ columns)
    seen = squares > 1e-6 * squares[-1]
    span: Array = columns @ (directions[:, seen] / np.sqrt(squares[seen]))
    return span


def scatter_of(repeated: Sequence[tuple[ScatteredRuns, Array]]) -> RunScatter:
    """Return the scatter that makes the differences between repeated runs most likely, given the noise (N,) mm of each
    group.

    Few repeats leave it uncertain, so the posterior mean square is returned and not the most likely value.
    """
    joints, ball, share = (axis.ravel() for axis in np.meshgrid(_MULTIPLES, _MULTIPLES, _SHARES, indexing="ij"))
    squares = np.stack([joints**2 * (1 - share), ball**2 * (1 - share), joints**2 * share, ball**2 * share], axis=1)
    evidence = sum(_evidence(runs, sd_mm, squares) for runs, sd_mm in repeated)
    weight = np.exp(evidence - np.max(evidence))
    return RunScatter(*np.sqrt(weight @ squares / weight.sum()).tolist())


def _evidence(runs: ScatteredRuns, sd_mm: Array, squares: Array) -> Array:
    """Return the log evidence (s,) of scatters, given their squares (s, 4) in the order of `RunScatter`."""
    white = runs.whitened(sd_mm)
    constant, drifting = white.constant, white.drifting
    span = _span_of(np.concatenate([constant, *drifting], axis=1))
    waves = [drifting[:, :, own].transpose(1, 0, 2).reshape(len(constant), -1) for own in _OWN]
    inside = [span.T @ part for part in (*(constant[:, own] for own in _OWN), *waves)]
    C = np.tensordot(squares, np.stack([part @ part.T for part in inside]), axes=1)
    C[:, np.arange(len(C[0])), np.arange(len(C[0]))] += 1.0
    Z = white.apart @ span
    cost = np.einsum("nr,srn->s", Z, np.linalg.solve(C, np.broadcast_to(Z.T, (len(C), *Z.T.shape))))
    found: Array = -0.5 * ((len(Z) - 1) * np.linalg.slogdet(C)[1] + cost)
    return found
