"""Why the measured is not the nominal. One effect a file, named as in the rig file.

Each file says its `STAGE` and has one pure function `apply(effect, scene) -> scene` over the whole time-ordered
trace; a size of zero is the identity. A new file, with its class in `rigs/effects.py`, is at once a new candidate for
every simulation, fit and diagnosis.
"""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from types import ModuleType

from analysis.model.scene import Scene, Stage
from rigs.effects import Effect


def apply(effects: Sequence[Effect], stage: Stage, scene: Scene) -> Scene:
    """The scene after all effects of a stage, in their order."""
    for effect in effects:
        module = module_of(effect)
        if stage == module.STAGE:
            scene = module.apply(effect, scene)
    return scene


def module_of(effect: Effect) -> ModuleType:
    """The file that serves an effect."""
    return importlib.import_module(f"analysis.effects.{effect.effect}")
