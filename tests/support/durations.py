"""Which processor time each test and each fixture took, kept from run to run: `scripts/dev durations` prints it.

A plugin of pytest, which `tests/conftest.py` loads. A session leaves a file in `.pytest_cache/d/durations`; of a test
the newest counts, so a run of one file replaces what was kept of that file alone.
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
"""Sessions that are kept: some twenty runs of `scripts/test`, which are two each."""
LEAST_S = 0.01
"""A fixture that takes less is not listed."""


@dataclass
class Durations:
    """Processor time in seconds of tests, and of fixtures by the test that asked first; which tests are a night's."""

    tests: dict[str, float] = field(default_factory=dict)
    fixtures: dict[str, dict[str, float]] = field(default_factory=dict)
    nightly: set[str] = field(default_factory=set)

    def by_file(self) -> dict[str, float]:
        """The sum over the tests of each file."""
        files: defaultdict[str, float] = defaultdict(float)
        for test, seconds in self.tests.items():
            files[file_of(test)] += seconds
        return dict(files)

    def by_fixture(self) -> dict[str, list[float]]:
        """What each making of a fixture took."""
        made: defaultdict[str, list[float]] = defaultdict(list)
        for fixtures in self.fixtures.values():
            for name, seconds in fixtures.items():
                made[name].append(seconds)
        return dict(made)


def file_of(test: str) -> str:
    """The file of a test, by its node id."""
    return test.partition("::")[0]


def durations(kept: Path = KEPT, root: Path = ROOT) -> Durations:
    """Return what the sessions of a folder took, the newest of each test whose file is still there."""
    found = Durations()
    for path in sorted(kept.glob("*.json")):
        session = json.loads(path.read_text(encoding="utf-8"))
        for test, (seconds, fixtures, is_nightly) in session.items():
            if (root / file_of(test)).exists():
                found.tests[test], found.fixtures[test] = seconds, fixtures
                (found.nightly.add if is_nightly else found.nightly.discard)(test)
    return found


class Watch:
    """Hooks that measure in the process of a test, and keep what all processes measured in the one that reports.

    What a phase took is an attribute of its report, which pytest-xdist hands over as it is.
    """

    def __init__(self) -> None:
        self._fixtures: dict[str, float] = {}
        self._took_s = 0.0
        self._tests: dict[str, tuple[float, dict[str, float], bool]] = {}

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_fixture_setup(self, fixturedef: pytest.FixtureDef[object]) -> Generator[None, object, object]:
        """Measure what a fixture takes, with those that it asks for."""
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
        """Write into the report of a phase what it took."""
        report = yield
        report.processor_s, self._took_s = round(self._took_s, 4), 0.0  # type: ignore[attr-defined]
        report.fixtures_s, self._fixtures = self._fixtures, {}  # type: ignore[attr-defined]
        report.is_nightly = item.get_closest_marker("nightly") is not None  # type: ignore[attr-defined]
        return report

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Add up the phases of a test, and its tries."""
        seconds, fixtures, _ = self._tests.get(report.nodeid, (0.0, {}, False))
        seconds += getattr(report, "processor_s", 0.0)
        fixtures = fixtures | getattr(report, "fixtures_s", {})
        self._tests[report.nodeid] = seconds, fixtures, getattr(report, "is_nightly", False)

    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        """Keep what was measured, in the process that reports."""
        config = session.config
        if not self._tests or hasattr(config, "workerinput") or not hasattr(config, "cache"):
            return
        folder = config.cache.mkdir("durations")
        (folder / f"{time.time_ns()}.json").write_text(json.dumps(self._tests), encoding="utf-8")
        for old in sorted(folder.glob("*.json"))[:-MOST_FILES]:
            old.unlink(missing_ok=True)


def pytest_configure(config: pytest.Config) -> None:
    """Watch each session."""
    config.pluginmanager.register(Watch(), "durations-watch")
