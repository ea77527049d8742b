"""The engine against emcee: mean and standard deviation of every value of one small case, posterior beside posterior.

emcee's ensemble sampler calls the forward model for every value and knows nothing of columns, fits or derivatives; the
priors are the same. Walkers begin twice as far apart as the engine states. Exit code 1 where a mean or a standard
deviation differs by more than 5 % of the standard deviation, and by more than chance makes of it.
"""

from __future__ import annotations

import sys
import time
from argparse import Namespace
from collections.abc import Iterator, Sequence

import emcee
import numpy as np

from tests.support.outsider import Stated, case, stated
from tests.support.trial import Trial, main, markdown

GOAL = 0.05
WALKERS, BURNT = 48, 0.25
CHANCE = 3.0
"""Standard errors of a sampled figure, estimated from its autocorrelation, by which chance may move it."""


def sampled(one: Stated, steps: int, seed: int) -> emcee.EnsembleSampler:
    rng = np.random.default_rng(seed)
    begin = one.mean + 2 * one.u * rng.standard_normal((WALKERS, len(one.u)))
    low, high = one.limits
    begin = np.clip(begin, low + 0.01 * one.u, high - 0.01 * one.u)
    # A third of the stretch move's autocorrelation. Snooker moves of emcee 3.1.6 sample a normal distribution 10 % too
    # narrow (its pull request 531).
    sampler = emcee.EnsembleSampler(WALKERS, len(one.u), one.log_density, moves=emcee.moves.DEMove())
    sampler.random_state = np.random.RandomState(seed).get_state()
    sampler.run_mcmc(begin, steps)
    return sampler


def draw(given: Namespace) -> Iterator[tuple[int, int]]:
    yield given.steps, given.seed


def judged(drawn: tuple[int, int]) -> tuple[str, int]:
    """The table, and the number of values that miss the goal."""
    steps, seed = drawn
    begin = time.process_time()
    one = stated(case(seed))
    engine_s = time.process_time() - begin
    sampler = sampled(one, steps, seed)
    chain = sampler.get_chain(discard=int(BURNT * steps))
    flat = chain.reshape(-1, chain.shape[-1])
    many = len(flat) / emcee.autocorr.integrated_time(chain, quiet=True)
    mean, sd = flat.mean(axis=0), flat.std(axis=0)
    off, ratio, chance = (one.mean - mean) / sd, one.u / sd, CHANCE / np.sqrt(many)
    far = (np.abs(off) > GOAL + chance) | (np.abs(ratio - 1) > GOAL + chance / np.sqrt(2))
    rows = []
    for k, name in enumerate(one.names):
        cells = [f"{value:.6g}" for value in (one.mean[k], one.u[k], mean[k], sd[k])]
        rows.append([name, *cells, f"{off[k]:+.3f}", f"{ratio[k]:.3f}", f"{many[k]:.0f}", "MISSED" if far[k] else ""])
    head = ("value", "engine", "u", "emcee: mean", "sd", "difference over sd", "u over sd", "independent samples", "")
    text = (
        f"engine {engine_s:.2f} s, emcee {time.process_time() - begin - engine_s:.0f} s of CPU; {len(flat)} samples,\n"
        f"accepted {np.mean(sampler.acceptance_fraction):.2f}; seed {seed}\n\n{markdown(head, rows)}\n\n"
        f"largest difference of means {np.abs(off).max():.3f} sd, of u {np.abs(ratio - 1).max():.3f}; goal {GOAL:g}, "
        f"chance (1 sigma) {np.max(1 / np.sqrt(many)):.3f}: {far.sum()} missed"
    )
    return text, int(far.sum())


def has_missed(done: Sequence[tuple[str, int]]) -> bool:
    return any(missed for _, missed in done)


TRIAL = Trial(
    draw,
    judged,
    line=lambda one: one[0],
    failed=has_missed,
    options={
        "steps": (4000, "of each walker (4000: three minutes of CPU)"),
        "seed": (0, "of the noise of the case (0)"),
    },
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
