"""Settings of every test process, and selection of nightly tests."""

import gc
import math
import signal
import time

import pytest
from hypothesis import HealthCheck, settings

from tests.support.nightly import NIGHT_IS_OVER, is_moved

pytest_plugins = ["tests.support.cpu_limit", "tests.support.durations"]

# How long examples take on a busy computer is no subject of any property.
settings.register_profile("busy", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("busy")
gc.set_threshold(100_000)
"""As the command `rig` has it: looking through 6600 collected tests every few hundred objects costs a tenth to a third
of the processor time that collecting and quick tests take (14.1 s for 9.5 s of collecting, measured)."""


if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    # What a shell script leaves in the background, a night say, begins without Ctrl-C, and so would what tests start.
    signal.signal(signal.SIGINT, signal.default_int_handler)
if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:  # as by nohup
    signal.signal(signal.SIGHUP, signal.SIG_DFL)


def pytest_addoption(parser: pytest.Parser) -> None:
    """The option of `scripts/dev nightly`."""
    parser.addoption("--night-ends", type=float, default=math.inf, help="begin no test after this time of the clock, s")


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Begin nothing after the end of a night."""
    if time.time() > item.config.getoption("--night-ends"):
        pytest.skip(NIGHT_IS_OVER)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Deselect nightly tests unless requested."""
    for item in items:
        if is_moved(item.nodeid):
            item.add_marker(pytest.mark.nightly)
    if "nightly" not in config.option.markexpr:
        config.hook.pytest_deselected(items=[item for item in items if item.get_closest_marker("nightly")])
        items[:] = [item for item in items if not item.get_closest_marker("nightly")]


def pytest_collection_finish(session: pytest.Session) -> None:
    """Leave what has been collected out of every later search: it stays until the end."""
    gc.freeze()
