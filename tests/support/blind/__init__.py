"""What runs and scores the blind trial (docs/blind-trial.md); its generator is `tests.support.stranger`."""
