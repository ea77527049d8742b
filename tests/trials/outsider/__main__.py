"""The engine against emcee: mean and standard deviation of every value of one small case, posterior beside posterior.

emcee's ensemble sampler calls the forward model for every value and knows nothing of columns, fits or derivatives; the
priors are the same. Walkers begin twice as far apart as the engine states. Exit code 1 where a mean or a standard
deviation differs by more than 5 % of the standard deviation, and by more than chance makes of it.
"""

from __future__ import annotations

import argparse
import sys
import time

import emcee
import numpy as np

from tests.support.outsider import Stated, case, stated

GOAL = 0.05
WALKERS, BURNT = 48, 0.25
CHANCE = 3.0
"""Standard errors of a sampled figure, estimated from its autocorrelation, by which chance may move it."""


def sampled(one: Stated, steps: int, seed: int) -> emcee.EnsembleSampler:
    """Return the sampler after its steps."""
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


def main() -> int:
    """Sample, print the table; 1 where the goal is missed."""
    parser = argparse.ArgumentParser(prog="scripts/dev outsider", description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--steps", type=int, default=4000, help="of each walker (4000: three minutes of CPU)")
    parser.add_argument("--seed", type=int, default=0, help="of the noise of the case (0)")
    given = parser.parse_args()
    begin = time.process_time()
    one = stated(case(given.seed))
    engine_s = time.process_time() - begin
    sampler = sampled(one, given.steps, given.seed)
    chain = sampler.get_chain(discard=int(BURNT * given.steps))
    tau = emcee.autocorr.integrated_time(chain, quiet=True)
    flat = chain.reshape(-1, chain.shape[-1])
    many = len(flat) / tau
    mean, sd = flat.mean(axis=0), flat.std(axis=0)
    off, ratio = (one.mean - mean) / sd, one.u / sd
    print(f"engine {engine_s:.2f} s, emcee {time.process_time() - begin - engine_s:.0f} s of CPU; {len(flat)} samples,")
    print(f"accepted {np.mean(sampler.acceptance_fraction):.2f}; seed {given.seed}\n")
    print("| value | engine | u | emcee: mean | sd | difference over sd | u over sd | independent samples |")
    print("|" + " --- |" * 8)
    missed = 0
    for k, name in enumerate(one.names):
        cells = [f"{value:.6g}" for value in (one.mean[k], one.u[k], mean[k], sd[k])]
        chance = CHANCE / np.sqrt(many[k])
        far = bool(abs(off[k]) > GOAL + chance or abs(ratio[k] - 1) > GOAL + chance / np.sqrt(2))
        missed += far
        print(f"| {name} | {' | '.join(cells)} | {off[k]:+.3f} | {ratio[k]:.3f} | {many[k]:.0f} |{' MISSED' * far}")
    print(f"\nlargest difference of means {np.abs(off).max():.3f} sd, of u {np.abs(ratio - 1).max():.3f}; "
          f"goal {GOAL:g}, chance (1 sigma) {np.max(1 / np.sqrt(many)):.3f}: {missed} missed")  # fmt: skip
    return int(missed > 0)


if __name__ == "__main__":
    sys.exit(main())
