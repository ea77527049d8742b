"""A storm of faults in simulated time: the daemon comes through it, and one with a planted bug does not."""

import pytest

from tests.support.nightly import cases
from tests.trials.storm.mutants import MUTANTS
from tests.trials.storm.storm import weather

FOUND_IN = {
    "synced before it is": 5,
    "first batch after an outage lost": 0,
    "overflow not counted": 5,
    "stamped after reading": 0,
    "no third connection": 2,
}
"""The first world from seed 0 on, of seconds, in which a storm finds each of the planted bugs."""


@pytest.mark.parametrize("seed", cases((0, 2, 5), (0, 2)))
def test_the_daemon_comes_through_the_storm_the_same_each_time(seed):
    told = weather(seed)
    assert told.violations == [], f"scripts/dev storm --seed {seed}"
    assert told.rows and told.blows
    if seed == 2:
        again = weather(seed)
        assert (told.rows, told.blows, told.faults, told.seconds) == (
            again.rows,
            again.blows,
            again.faults,
            again.seconds,
        )


# A bug that is planted tests the storm: one of the daemon's and one of its clock in each commit.
@pytest.mark.parametrize("name", cases(MUTANTS, ("first batch after an outage lost", "stamped after reading")))
def test_a_planted_bug_is_found(name):
    with MUTANTS[name]():
        assert weather(FOUND_IN[name]).violations, name
