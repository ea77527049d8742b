"""What every process of the tests begins with, and when a test that watches real time is repeated."""

from __future__ import annotations

import gc
from collections.abc import Generator

import pytest

from tests.support.stalls import Stalls

TRIES = 3
HELD_UP_S = 0.1
"""A shorter stall is no error of a test that watches real time, unless its marker gives a shorter one. It is less than
half the time-out of most emulated instruments."""

gc.set_threshold(100_000)
"""As the command `rig` has it: looking through 6600 collected tests every few hundred objects costs a tenth to a third
of the processor time that collecting and quick tests take (14.1 s for 9.5 s of collecting, measured)."""


class HeldUpError(Exception):
    """A test failed while this computer stood still, so it says nothing about the program."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Repeat tests that watch real time where the computer stood still, each try with the whole time limit."""
    for item in items:
        if _held_up_s(item) is not None:
            limit = item.get_closest_marker("timeout")
            item.add_marker(pytest.mark.timeout(*(limit.args if limit else ()), func_only=True), append=False)
            item.add_marker(pytest.mark.flaky(reruns=TRIES - 1, only_rerun=HeldUpError.__name__))


def pytest_collection_finish(session: pytest.Session) -> None:
    """Leave what has been collected out of every later search: it stays until the end."""
    gc.freeze()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, None, None]:
    """Judge a failure of a test that watches real time only where the computer did not stand still."""
    limit_s = _held_up_s(item)
    if limit_s is None:
        return (yield)
    try:
        with Stalls() as stalls:
            return (yield)
    except (Exception, pytest.fail.Exception) as error:
        if stalls.worst_s < limit_s:
            raise
        stood = f"this computer stood still for {stalls.worst_s:.2f} s"
        if item.execution_count < TRIES:  # type: ignore[attr-defined]
            raise HeldUpError(stood) from error
        line = str(error).partition("\n")[0]
        pytest.skip(f"{item.name}: {stood} in the last of {TRIES} tries, so nothing follows from this: {line}")


def _held_up_s(item: pytest.Item) -> float | None:
    """The stall in s from which a failure of a test says nothing; None for a test that does not watch real time."""
    marker = item.get_closest_marker("real_time")
    if marker is not None:
        return float(marker.kwargs.get("held_up_s", HELD_UP_S))
    return HELD_UP_S if item.get_closest_marker("alone") else None
