"""A test fails by the processor time that it takes, so that none fails because the computer has other work.

A plugin of pytest, which `tests/conftest.py` loads. The marker `cpu_limit(SECONDS)` gives a test another limit than
`CPU_LIMIT_S`; one that watches real time has a time limit instead. A test that waits for ever takes no processor time:
the time limit of `pyproject.toml` ends it.
"""

from __future__ import annotations

import resource
import signal
import time
from collections.abc import Generator
from contextlib import AbstractContextManager, contextmanager, nullcontext

import pytest

CPU_LIMIT_S = 60.0
"""Some four times what the longest test without a marker takes on a busy computer, whose cores share their caches."""


class OverCpuLimitError(BaseException):
    """The test has taken more processor time than it may; no Exception, of which hypothesis would look for a smaller
    example."""


def cpu_s() -> float:
    """The processor time of this process and of the children that it has waited for."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


@contextmanager
def cpu_limit(limit_s: float) -> Generator[None, None, None]:
    """Raise OverCpuLimitError as soon as this process, or at the end as this process with its children, has taken more
    processor time than `limit_s`. Only for the main thread."""

    def over(*_: object) -> None:
        raise OverCpuLimitError(f"took more than {limit_s:g} s of processor time")

    began, before = cpu_s(), signal.signal(signal.SIGPROF, over)
    timer = signal.setitimer(signal.ITIMER_PROF, limit_s)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)
        signal.setitimer(signal.ITIMER_PROF, *timer)
    if cpu_s() - began > limit_s:
        over()


def _limited(item: pytest.Item) -> AbstractContextManager[None]:
    """What limits each phase of a test."""
    if item.get_closest_marker("real_time"):
        return nullcontext()
    marker = item.get_closest_marker("cpu_limit")
    return cpu_limit(float(marker.args[0]) if marker else CPU_LIMIT_S)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_setup(item: pytest.Item) -> Generator[None, None, None]:
    """Limit what the fixtures of a test take."""
    with _limited(item):
        return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, None, None]:
    """Limit what the test itself takes."""
    with _limited(item):
        return (yield)
