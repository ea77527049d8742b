"""Tests that hold for every language, every maker, or both directions."""

import pytest

from analysis.apps.report.texts import LANGUAGES
from rigs.makers import MAKERS

in_every_language = pytest.mark.parametrize("language", LANGUAGES)
for_every_maker = pytest.mark.parametrize("dialect", MAKERS)
both_ways = pytest.mark.parametrize("direction", ["acw", "cw"])
