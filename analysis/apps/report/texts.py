"""The fixed texts of each language, and the labels of the figures in their order, from `texts.LANGUAGE.yaml`.

Answers that exist in English only have their sentences in `english.yaml`.

All languages have the same keys. The page uses the selected language; screen and picture use English. Sentences
composed by the analysis, such as doubts and remedies, stay English.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Any, Literal, get_args

import yaml

from rigs.schema.robot import Robot

LEADING = frozenset({"band_deg", "band_mm", "uni_mm", "bi_mm", "rms_mm", "radius_mm", "line_at_mm"})
"""Figures printed in bold: the ones the paper reports."""


def in_order(names: Iterable[str]) -> list[str]:
    """Return distinct figure names in the order of the labels, details below their main line; unknown names last."""
    place = {name: k for k, name in enumerate(texts_of("en").labels)}
    return sorted(dict.fromkeys(names), key=lambda name: place.get(name, len(place)))


def label(name: str) -> str:
    """Return the English label of a figure in a table, or the name if it has none."""
    return texts_of("en").label(name)


def whole_label(name: str, label: Callable[[str], str] = label) -> str:
    """Return the label of a figure outside a table, a detail after the main line: `position error, largest`."""
    text = label(name)
    if not text.startswith(" "):
        return text
    known = list(texts_of("en").labels)
    above = next(main for main in known[known.index(name) :: -1] if not label(main).startswith(" "))
    # The place of the largest value is a detail of that line; a mean belongs to the rms.
    of = label(above) if name.endswith("_at_deg") else label(above).partition(", ")[0]
    return f"{of}, {text.strip()}"


Language = Literal["en", "de", "ko"]
LANGUAGES: tuple[Language, ...] = get_args(Language)


class Phrase(str):
    """A text of the catalogue that knows its key, the keys of the texts inserted into it, and the values."""

    __slots__ = ("keys", "values")
    keys: tuple[str, ...]
    values: Mapping[str, object]

    def __new__(cls, text: str, keys: tuple[str, ...] = (), values: Mapping[str, object] | None = None) -> Phrase:
        sentence = super().__new__(cls, text)
        sentence.keys, sentence.values = keys, values or {}
        return sentence

    def __getnewargs__(self) -> tuple[str, tuple[str, ...]]:  # type: ignore[override]
        return str(self), self.keys


def keys_of(text: object) -> tuple[str, ...]:
    return text.keys if isinstance(text, Phrase) else ()


def capital(text: str) -> Phrase:
    """Return a text with a capital first letter, and its keys."""
    return Phrase(f"{text[:1].upper()}{text[1:]}", keys_of(text))


def joined(texts: Iterable[str], by: str = " ") -> Phrase:
    shown = [text for text in texts if text]
    return Phrase(by.join(shown), tuple(key for text in shown for key in keys_of(text)))


@dataclass(frozen=True)
class Texts:
    """Texts by key, labels of figures by name, and nouns for effects.

    nouns contains only the effects whose standard name this language replaces.
    """

    language: Language
    words: dict[str, str]
    labels: dict[str, str]
    nouns: dict[str, str]

    def __call__(self, key: str, /, **values: object) -> Phrase:
        keys = (key, *(inner for value in values.values() for inner in keys_of(value)))
        return Phrase(self.words[key].format(**values), keys, values)

    def counted(self, key: str, count: int, **values: object) -> str:
        singular = f"{key}_single"
        return self(singular if count == 1 and singular in self.words else key, count=count, **values)

    def test(self, name: str) -> str:
        return self.words.get(f"test_{name}", name)

    def not_known(self, share: float) -> str:
        """Return the sentence about the share of the work with unknown accuracy; empty for 0."""
        key = "work_unknown_all" if share == 1 else "work_unknown"
        return self(key, share=f"{max(100 * share, 1):.0f} %") if share else ""

    def axis(self, robot: Robot, axis: int) -> str:
        """Return the name of an axis, counted from 1: `axis 4 (gamma)`."""
        name = robot.own_name(axis)
        return self("axis_of", axis=axis, name=name) if name else self("axis_numbered", axis=axis)

    def label(self, name: str) -> str:
        """Return the label of a figure, in English if this language has none."""
        return self.labels.get(name) or texts_of("en").labels.get(name, name)


@cache
def texts_of(language: Language) -> Texts:
    read = _template(f"texts.{language}")
    return Texts(language, _template("english") | read["words"], read["labels"], read["nouns"])


def _template(name: str) -> dict[str, Any]:
    file = resources.files("analysis") / "templates" / f"{name}.yaml"
    # a text file of this package; the loader in C is ten times faster
    loaded: dict[str, Any] = yaml.load(file.read_text("utf-8"), getattr(yaml, "CSafeLoader", yaml.SafeLoader))  # noqa: S506
    return loaded
