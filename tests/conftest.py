"""Settings of every test process, selection of nightly tests, and repetition of interrupted tests of real time."""

import gc
import math
import os
import re
import signal
import time
from collections.abc import Generator

import pytest
from hypothesis import HealthCheck, settings

from tests.support.nightly import NIGHT_IS_OVER, is_moved
from tests.support.stalls import Stalls

pytest_plugins = ["tests.support.cpu_limit", "tests.support.durations"]
TRIES = 3
_UNJUDGED = f"each of {TRIES} tries was held up, so nothing follows from it"
MOST_UNJUDGED = 3
"""Tests that may be held up in every try on the computer of continuous integration."""
HELD_UP_S = 0.1
"""A shorter stall is no reason for a test that watches real time to fail, unless its marker says so. It is less than
half the time-out of most emulated instruments."""

# How long examples take on a busy computer is no subject of any property.
settings.register_profile("busy", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("busy")
gc.set_threshold(100_000)
"""As the command `rig` has it: looking through 6600 collected tests every few hundred objects costs a tenth to a third
of the processor time that collecting and quick tests take (14.1 s for 9.5 s of collecting, measured)."""


class HeldUpError(Exception):
    """A test failed after it was held up for longer than it may be, so the failure says nothing about the program."""


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
    """Deselect nightly tests unless requested, and repeat tests of real time after an interruption, each with the
    complete
    time limit.
    """
    for item in items:
        if is_moved(item.nodeid):
            item.add_marker(pytest.mark.nightly)
    if "nightly" not in config.option.markexpr:
        config.hook.pytest_deselected(items=[item for item in items if item.get_closest_marker("nightly")])
        items[:] = [item for item in items if not item.get_closest_marker("nightly")]
    for item in items:
        if _real_time(item):
            limit = item.get_closest_marker("timeout")
            args, kwargs = (limit.args, limit.kwargs) if limit else ((), {})
            item.add_marker(pytest.mark.timeout(*args, **{**kwargs, "func_only": True}), append=False)
            item.add_marker(pytest.mark.flaky(reruns=TRIES - 1, only_rerun=HeldUpError.__name__))


def pytest_collection_finish(session: pytest.Session) -> None:
    """Leave what has been collected out of every later search: it stays until the end."""
    gc.freeze()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, None, None]:
    """Judge a failure of a test that watches real time only where the test was not held up.

    A test that reaches its time limit has failed: no stall lasts as long.
    """
    marker = _real_time(item)
    if marker is None:
        return (yield)
    try:
        with Stalls() as stalls:
            return (yield)
    except Exception as error:
        is_late = stalls.worst_s >= marker.kwargs.get("held_up_s", HELD_UP_S)
        if not (is_late and re.search(marker.kwargs.get("match", ""), str(error))):
            raise
        line = f"held up for {stalls.worst_s:.2f} s, then: " + str(error).partition("\n")[0]
        if item.execution_count < TRIES:  # type: ignore[attr-defined]
            raise HeldUpError(line) from error
        pytest.skip(f"{item.name}: {_UNJUDGED}; the last {line}")


@pytest.hookimpl(wrapper=True)
def pytest_sessionfinish(session: pytest.Session) -> Generator[None, None, None]:
    """Fail in continuous integration if more than a few tests were skipped because of interruptions."""
    yield
    terminal = session.config.pluginmanager.get_plugin("terminalreporter")
    skipped = [str(report.longrepr) for report in terminal.getreports("skipped")] if terminal else []
    unjudged = sum(_UNJUDGED in reason for reason in skipped)
    if os.environ.get("CI") and unjudged > MOST_UNJUDGED:
        terminal.write_line(f"{unjudged} tests could not be judged, more than {MOST_UNJUDGED}: that is a failure in CI")
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Print why tests were repeated: a program that is at fault now and then would be seen here only."""
    for report in terminalreporter.getreports("rerun"):
        crash = getattr(report.longrepr, "reprcrash", None)  # None where a worker died
        terminalreporter.write_line(f"{report.nodeid}: {crash.message if crash else report.longrepr}")


def _real_time(item: pytest.Item) -> pytest.Mark | None:
    """The marker of a test that watches real time."""
    return item.get_closest_marker("real_time")
