"""Rigs and rig files with a changed robot, changed tests, or other keys."""

from __future__ import annotations

from typing import Any

import yaml

from rigs.load import SHIPPED, parse
from rigs.rig import Rig


def shipped(name: str = "ur10e-cell") -> dict[str, Any]:
    """The data of a shipped rig file."""
    data: dict[str, Any] = yaml.safe_load((SHIPPED / f"{name}.yaml").read_text(encoding="utf-8"))
    return data


def rig_with(rig: str = "ur10e-cell", /, **keys: Any) -> Rig:
    """A shipped rig with other values of top-level keys."""
    return parse(yaml.safe_dump(shipped(rig) | keys), "changed.yaml")


def with_robot(rig: Rig, **changes: object) -> Rig:
    return rig.model_copy(update={"robot": rig.robot.model_copy(update=changes)})


def with_tests(rig: Rig, **changes: object) -> Rig:
    return rig.model_copy(update={"tests": rig.tests.model_copy(update=changes)})


def with_circle(rig: Rig, **changes: object) -> Rig:
    assert rig.tests.circle
    return with_tests(rig, circle=rig.tests.circle.model_copy(update=changes))
