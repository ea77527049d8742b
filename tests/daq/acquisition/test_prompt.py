import gc
import sys

import pytest

from daq.acquisition.reader import keep_stamps_prompt


@pytest.fixture(autouse=True)
def _as_before():
    interval_s = sys.getswitchinterval()
    yield
    sys.setswitchinterval(interval_s)
    gc.unfreeze()


def test_collector_ignores_existing_objects_and_threads_switch_sooner():
    before_s, there = 0.005, [[]]
    sys.setswitchinterval(before_s)  # Python's own; a daemon that ran in this process has changed it
    keep_stamps_prompt()
    assert sys.getswitchinterval() < before_s / 5
    assert not any(found is there for found in gc.get_objects())
