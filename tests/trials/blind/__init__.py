"""Run and score the blind trial (docs/trials.md). `tests.worlds.stranger` generates its cells."""
