"""A small calibration case whose posterior can be computed by the engine and by any sampler of a log density.

A tracker measured poses of a UR10 with known noise. The named effects are backlash of axis 2 and a wave of axis 1.
Further unknowns are a joint zero and a link length with priors of a healthy arm, and the placement of tracker and
target. The engine states a normal distribution around its fit; the log density evaluates the complete forward model.
Backlash and wave have the ideal form. Deviations from it are additional columns of the engine that no other program
knows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from analysis.diagnosis.evidence.blocks import blocks_of
from analysis.diagnosis.evidence.observation import ObservedRun, observe_run
from analysis.diagnosis.evidence.setups import fit_run_setups, moved_setup
from analysis.diagnosis.fit.background import CoefficientPosterior, background_of
from analysis.diagnosis.fit.candidates import HEALTHY, Candidate, Columns, forms_of, healthy_shares
from analysis.diagnosis.fit.refine import Refined, UnknownParameter, refine, size_limits
from analysis.diagnosis.fit.responses import Linearisation, linearise
from analysis.procedures.shared.test_kind import nominal_setup, path_of, predict
from analysis.robot.kinematics.arm import Array
from analysis.robot.predict import SetUp, model_of
from analysis.runs.tables import PoseTable
from rigs.effects import Backlash, Effect, JointOffset, LinkGeometry, TransmissionError, bounds, size_field
from rigs.load import load
from rigs.schema.effect import PHASE, Departures, healthy, name_of, scaled

NOISE_MM = 0.03
"""Standard deviation of each coordinate, known to both programs."""


class Play(Backlash):
    """Backlash with the ideal form only."""

    def departures(self) -> Departures:
        return Departures()


class Wave(TransmissionError):
    """Gear wave with the ideal form only."""

    def departures(self) -> Departures:
        return Departures()


HIDDEN = (
    Play(axis=2, width_deg=0.06, transit=0.5, preload=0.3),
    Wave(axis=1, order=3.2, amplitude_deg=0.03, phase_deg=40.0, third=0.2),
)
BEGUN = (
    Play(axis=2, width_deg=0.05, transit=0.2, preload=0.1),
    Wave(axis=1, order=3.0, amplitude_deg=0.02, phase_deg=20.0),
)
"""Initial values of the engine's fit."""
FURTHER_EFFECTS = (healthy(JointOffset(axis=4)), healthy(LinkGeometry(axis=3, field="a")))
TIMES = (0.8, -1.3)
"""True sizes of the arm in healthy sizes."""
STATIONS, STEPS, STEP_DEG = 36, 6, 0.06
"""Number of postures, number of small steps of axis 2 after each, and their standard deviation. The steps reveal how
the axis crosses its backlash.
"""
_TURNS = 3
_PLACED_MM = 1000.0
"""Prior standard deviation of each placement term, as in the engine."""


@dataclass(frozen=True)
class Case:
    """Measured poses (n), and a set-up close to the true placement."""

    run: ObservedRun
    begun: dict[str, SetUp]

    def predicted(self, effects: Sequence[Effect], setup: SetUp) -> Array:
        """Positions (n, 3) mm predicted by the forward model."""
        model = replace(self.run.model, effects=tuple(effects))
        return predict(model, self.run.table, self.run.path, setup)[:, [3, 7, 11]]


def case(seed: int) -> Case:
    """Simulate the poses with the noise of a seed."""
    rng = np.random.default_rng(seed)
    low, high = np.radians([-150, -120, -120, -150, -150, -170]), np.radians([150, -30, 120, 150, 150, 170])
    q = np.repeat(rng.uniform(low, high, (STATIONS, 6)), 1 + STEPS, axis=0)
    q[:, 1] += np.radians(STEP_DEG) * rng.standard_normal(len(q))
    model = replace(model_of(load("ur10-cell")[0]), effects=())
    came_from = np.concatenate([q[:1], q[:-1]])
    empty = PoseTable(q, np.zeros((len(q), 3)), None, came_from=came_from)
    there = moved_setup(nominal_setup(model.rig, empty), empty, rng.normal(0, 30, 9))
    others = [scaled(one, times) for one, times in zip(FURTHER_EFFECTS, TIMES, strict=True)]
    holding = replace(model, effects=(*HIDDEN, *others))
    xyz = predict(holding, empty, path_of(model, empty), there)[:, [3, 7, 11]]
    seen = replace(empty, xyz_mm=xyz + rng.normal(0, NOISE_MM, xyz.shape))
    run = observe_run(model, seen, "poses")
    return Case(run, fit_run_setups([run])[0])


@dataclass(frozen=True)
class Stated:
    """Result of the engine for a case at a linearisation: the fit, and the posterior of each size, in healthy sizes,
    and of the nine placement terms in mm.
    """

    case: Case
    linear: Linearisation
    refined: Refined
    posterior: CoefficientPosterior

    @property
    def mean(self) -> Array:
        """Mean (d,) of all values, including the last step of the fit."""
        fitted = self.refined.values
        return np.concatenate([fitted + self.posterior.term_means[: len(fitted)], self.posterior.mean])

    @property
    def u(self) -> Array:
        """Standard uncertainties (d,) of all values."""
        return np.sqrt(np.concatenate([np.diag(self.refined.covariance), self.posterior.variance]))

    @cached_property
    def covariance(self) -> Array:
        """Covariance (d, d) of all values."""
        return self.posterior.joint(len(FURTHER_EFFECTS) + 9, len(self.refined.values))[1]

    @cached_property
    def limits(self) -> Array:
        """Lower and upper limits (2, d)."""
        return np.array(
            [*map(self._limits_of, self.refined.unknowns), *[(-np.inf, np.inf)] * (len(FURTHER_EFFECTS) + 9)]
        ).T

    def _limits_of(self, unknown: UnknownParameter) -> tuple[float, float]:
        """Bounds of a parameter in the vocabulary; for a size also those of a fit."""
        effect, field = self.refined.effects[unknown.effect], unknown.field
        if field == PHASE:
            return -np.inf, np.inf
        return size_limits(effect) if field == size_field(effect) else bounds(effect, field)

    @cached_property
    def _prior(self) -> tuple[Array, Array]:
        """Return mean and standard deviation (d,) of the prior of all values."""
        unknowns = self.refined.unknowns
        mean = [one.expected for one in unknowns] + [0.0] * (len(FURTHER_EFFECTS) + 9)
        sd = [one.spread for one in unknowns] + [1.0] * len(FURTHER_EFFECTS) + [_PLACED_MM] * 9
        return np.array(mean), np.array(sd)

    def log_density(self, values: Array) -> float:
        """Log of the posterior density of all values (d,), up to a constant, by the forward model."""
        if not ((values >= self.limits[0]) & (values <= self.limits[1])).all():
            return -np.inf
        effects = list(self.refined.effects)
        for unknown, value in zip(self.refined.unknowns, values, strict=False):
            effects[unknown.effect] = effects[unknown.effect].model_copy(update={unknown.field: float(value)})
        sizes, moves = values[-9 - len(FURTHER_EFFECTS) : -9], values[-9:]
        effects += [scaled(one, float(size)) for one, size in zip(FURTHER_EFFECTS, sizes, strict=True)]
        (setup,) = self.linear.setups.values()
        one = self.case.run
        left = one.values - self.case.predicted(effects, moved_setup(setup, one.table, moves))
        mean, sd = self._prior
        away = (values - mean) / sd
        return -0.5 * float(np.sum(left**2) / NOISE_MM**2 + away @ away)


def stated(one: Case) -> Stated:
    """Result of the engine, relinearised repeatedly at the previous placement and effects."""
    setups, known, effects = one.begun, (), BEGUN
    for _ in range(_TURNS):
        blocks = [replace(b, sd_mm=np.full(len(b.sd_mm), NOISE_MM)) for b in blocks_of([one.run], setups, known)]
        linear = linearise(blocks, setups, known)
        columns = _columns(linear)
        background = background_of(columns, np.ones(len(linear.y)), columns.variance(HEALTHY))
        found = refine(linear, background, effects)
        posterior = background.posterior(found.fitted_terms)
        effects = known = found.effects
        setups = linear.setups_moved_by(posterior.mean[columns.set_ups])
    return Stated(one, linear, found, posterior)


def _columns(linear: Linearisation) -> Columns:
    """Columns (N, p) of all unknowns except the named effects: other effects and placement."""
    forms = forms_of([Candidate(name_of(one), (one,)) for one in FURTHER_EFFECTS])
    share = healthy_shares(forms)
    return Columns(
        np.concatenate([linear.columns(FURTHER_EFFECTS), linear.U], axis=1),
        forms,
        slice(len(share), len(share) + 9),
        np.zeros(len(linear.y), dtype=np.int64),
        np.concatenate([share, np.zeros(9)]),
        np.concatenate([np.zeros(len(share)), np.full(9, _PLACED_MM**2)]),
        np.zeros(len(share) + 9),
    )
