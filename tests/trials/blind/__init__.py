"""What runs and scores the blind trial (docs/trials.md); its generator is `tests.worlds.stranger`."""
