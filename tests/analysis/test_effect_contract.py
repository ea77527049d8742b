"""Every effect of the vocabulary, and one that is written here, from the rig file to the correction."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from effect_contract import STEPS

from rigs.effects import VOCABULARY


@pytest.mark.parametrize("name", VOCABULARY)
@pytest.mark.parametrize("step", STEPS, ids=lambda step: step.__name__)
def test_every_effect_keeps_the_contract(step: Callable[[str], None], name: str) -> None:
    step(name)
