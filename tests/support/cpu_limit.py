"""Limit the processor time of each test, so that no test fails because the computer is busy.

This pytest plugin is loaded by `tests/conftest.py`. The marker `cpu_limit(SECONDS)` replaces the default `CPU_LIMIT_S`.
A blocked test uses no processor time and is ended by the time limit of `pyproject.toml`.
"""

from __future__ import annotations

import resource
import signal
import time
from collections.abc import Generator
from contextlib import AbstractContextManager, contextmanager

import pytest

CPU_LIMIT_S = 60.0
"""About four times the processor time of the longest unmarked test on a busy computer with shared caches."""


class OverCpuLimitError(BaseException):
    """A test has exceeded its processor time. It is not an Exception, because hypothesis would search for a smaller
    example.
    """


def cpu_s() -> float:
    """Processor time of this process and of its finished children."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


@contextmanager
def cpu_limit(limit_s: float) -> Generator[None, None, None]:
    """Raise OverCpuLimitError when the processor time exceeds `limit_s`. Only for the main thread.

    The time of this process is checked continuously, and at the end also that of its children.
    """

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
    marker = item.get_closest_marker("cpu_limit")
    return cpu_limit(float(marker.args[0]) if marker else CPU_LIMIT_S)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_setup(item: pytest.Item) -> Generator[None, None, None]:
    """Limit the fixtures of a test."""
    with _limited(item):
        return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, None, None]:
    """Limit the test function."""
    with _limited(item):
        return (yield)
