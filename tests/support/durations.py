"""Processor time of each test and fixture, stored between test runs. `scripts/dev durations` prints it.

This pytest plugin is loaded by `tests/conftest.py`. Each session writes a file in `.pytest_cache/d/durations`. The
newest time of each test counts, so a run of one test file updates only that file.
"""

from __future__ import annotations

import json
import time
from collections import defaultdict
from collections.abc import Generator
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from tests.support.cpu_limit import cpu_s

ROOT = Path(__file__).parents[2]
KEPT = ROOT / ".pytest_cache" / "d" / "durations"
MOST_FILES = 40
"""Number of stored sessions, about twenty runs of `scripts/test` with two sessions each."""
LEAST_S = 0.01
"""Fixtures faster than this are not listed."""


@dataclass
class Durations:
    """Processor time in seconds of tests, and of fixtures by the first test that requested them; and the nightly
    tests.
    """

    tests: dict[str, float] = field(default_factory=dict)
    fixtures: dict[str, dict[str, float]] = field(default_factory=dict)
    nightly: set[str] = field(default_factory=set)

    def by_file(self) -> dict[str, float]:
        """Total time of each test file."""
        files: defaultdict[str, float] = defaultdict(float)
        for test, seconds in self.tests.items():
            files[file_of(test)] += seconds
        return dict(files)

    def by_fixture(self) -> dict[str, list[float]]:
        """Times of all set-ups of each fixture."""
        made: defaultdict[str, list[float]] = defaultdict(list)
        for fixtures in self.fixtures.values():
            for name, seconds in fixtures.items():
                made[name].append(seconds)
        return dict(made)


def file_of(test: str) -> str:
    return test.partition("::")[0]


def durations(kept: Path = KEPT, root: Path = ROOT) -> Durations:
    """Read the durations stored in a directory: the newest of each test whose file still exists."""
    found = Durations()
    for path in sorted(kept.glob("*.json")):
        session = json.loads(path.read_text(encoding="utf-8"))
        for test, (seconds, fixtures, is_nightly) in session.items():
            if (root / file_of(test)).exists():
                found.tests[test], found.fixtures[test] = seconds, fixtures
                (found.nightly.add if is_nightly else found.nightly.discard)(test)
    return found


class Watch:
    """Pytest hooks that measure in the process of a test and store all times in the reporting process.

    The time of a phase is an attribute of its report, which pytest-xdist transfers.
    """

    def __init__(self) -> None:
        self._fixtures: dict[str, float] = {}
        self._took_s = 0.0
        self._tests: dict[str, tuple[float, dict[str, float], bool]] = {}

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_fixture_setup(self, fixturedef: pytest.FixtureDef[object]) -> Generator[None, object, object]:
        """Measure a fixture, including the fixtures it requests."""
        began_s = cpu_s()
        try:
            return (yield)
        finally:
            if (took_s := cpu_s() - began_s) >= LEAST_S:
                name = f"{fixturedef.baseid or 'pytest'}::{fixturedef.argname}"
                self._fixtures[name] = self._fixtures.get(name, 0.0) + round(took_s, 3)

    def _measured(self) -> Generator[None, object, object]:
        began_s = cpu_s()
        try:
            return (yield)
        finally:
            self._took_s = cpu_s() - began_s

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_setup(self) -> Generator[None, object, object]:
        return (yield from self._measured())

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_call(self) -> Generator[None, object, object]:
        return (yield from self._measured())

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_teardown(self) -> Generator[None, object, object]:
        return (yield from self._measured())

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(self, item: pytest.Item) -> Generator[None, pytest.TestReport, pytest.TestReport]:
        """Add the processor time of a phase to its report."""
        report = yield
        report.processor_s, self._took_s = round(self._took_s, 4), 0.0  # type: ignore[attr-defined]
        report.fixtures_s, self._fixtures = self._fixtures, {}  # type: ignore[attr-defined]
        report.is_nightly = item.get_closest_marker("nightly") is not None  # type: ignore[attr-defined]
        return report

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Add up the phases and repetitions of a test."""
        seconds, fixtures, _ = self._tests.get(report.nodeid, (0.0, {}, False))
        seconds += getattr(report, "processor_s", 0.0)
        fixtures = fixtures | getattr(report, "fixtures_s", {})
        self._tests[report.nodeid] = seconds, fixtures, getattr(report, "is_nightly", False)

    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        """Store all times, in the reporting process."""
        config = session.config
        if not self._tests or hasattr(config, "workerinput") or not hasattr(config, "cache"):
            return
        folder = config.cache.mkdir("durations")
        (folder / f"{time.time_ns()}.json").write_text(json.dumps(self._tests), encoding="utf-8")
        for old in sorted(folder.glob("*.json"))[:-MOST_FILES]:
            old.unlink(missing_ok=True)


def pytest_configure(config: pytest.Config) -> None:
    """Register the hooks for each session."""
    config.pluginmanager.register(Watch(), "durations-watch")
