"""Every effect of the vocabulary, from the rig file to the correction; tests/test_how_to_analysis.py adds one."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from rigs.effects import VOCABULARY
from tests.support.effect_contract import STEPS


@pytest.mark.timeout(600)  # the first plan, which the others share, takes 25 s of a core that it has for itself
@pytest.mark.parametrize("name", VOCABULARY)
@pytest.mark.parametrize("step", STEPS, ids=lambda step: step.__name__)
def test_every_effect_keeps_the_contract(step: Callable[[str], None], name: str) -> None:
    step(name)
