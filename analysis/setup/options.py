"""What the command line already answers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from rigs.errors import FileError, UseError
from rigs.schema.part import Part
from rigs.yaml_text import read_yaml

_SECTIONS = ("g1", "g2", "feedback")


@dataclass(frozen=True)
class Options:
    """The options of `rig init`; None and empty for what is to be asked. keys: by section, `g1` to `feedback`."""

    path: Path
    name: str
    robot: str | None
    ports: tuple[str, ...]
    places: tuple[str, ...]
    """Where g1 and g2 are, as far as they are given."""
    keys: dict[str, dict[str, Any]]
    baseline_mm: float | None
    arm: str | None
    tool: str | None
    tolerance_mm: float | None
    circle_here: bool | None
    radius_mm: float
    listen_s: float
    modbus_units: tuple[int, ...]


def keys_of(texts: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Return the keys of a rig file, given as `g1.range_mm=10`, by section. Raises UseError."""
    keys: dict[str, dict[str, Any]] = {section: {} for section in _SECTIONS}
    for text in texts:
        place, equals, value = text.partition("=")
        section, _, key = place.partition(".")
        if not equals or section not in keys or not key:
            raise UseError(f"--key {text}", "is not SECTION.KEY=VALUE", "write it as --key g1.range_mm=10")
        keys[section][key] = written(value, f"--key {text}")
    return keys


def places_of(g1: str | None, g2: str | None, keys: Mapping[str, Mapping[str, Any]]) -> tuple[str, ...]:
    """Return where g1 and g2 are, as far as they are given. Raises UseError for g2 alone, and for the interface of a
    gauge whose place is not given."""
    if g2 is not None and g1 is None:
        raise UseError("--g2", "is given without --g1", "give both, or neither")
    for gauge, place in (("g1", g1), ("g2", g2)):
        if "interface" in keys[gauge] and place is None:
            raise UseError(f"--key {gauge}.interface", f"is given without --{gauge}", f"give --{gauge} PORT as well")
    return tuple(place for place in (g1, g2) if place is not None)


def checked(schema: Any, fields: Any, section: str) -> Any:
    """Return a part of a rig file made from its keys, or of its value. Raises FileError with the first mistake."""
    try:
        return TypeAdapter(schema).validate_python(fields)
    except ValidationError as error:
        raise key_error(error, section) from None


def with_keys(schema: Any, part: Part, keys: Mapping[str, Any], section: str) -> Any:
    """Return a part of a rig file with these keys changed. Raises FileError."""
    return checked(schema, {**part.model_dump(mode="json", exclude_unset=True), **keys}, section) if keys else part


def has_keys(schema: Any, part: Part, keys: Mapping[str, Any]) -> bool:
    """Return whether a part of a rig file has these values already. Raises FileError."""
    return bool(with_keys(schema, part, keys, "--key") == part)


def key_error(error: ValidationError, section: str) -> FileError:
    """Return the first mistake in the keys of a section, and the option that corrects it."""
    first = error.errors(include_url=False)[0]
    key = next((str(step) for step in reversed(first["loc"]) if isinstance(step, str)), "interface")
    problem = first["msg"].removeprefix("Value error, ")
    if section.startswith("--"):
        return FileError(section, problem, "see rig init --help")
    return FileError(f"{section}.{key}", problem, f"give --key {section}.{key}=…; rig interfaces lists the keys")


def written(text: str, where: str) -> Any:
    """Return what was typed for a key, as YAML reads it. Raises RigFileError."""
    return read_yaml(text, where)[1]
