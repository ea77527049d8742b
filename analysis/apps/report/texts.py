"""Fixed texts of each language and labels of the figures, from `texts.LANGUAGE.yaml`, all with the same keys.

Answers in English only have their sentences in `english.yaml`. Doubts and remedies of the analysis stay English.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Any, Literal, get_args

import yaml

from rigs.schema.robot import Robot

LEADING = frozenset({"band_deg", "band_mm", "uni_mm", "bi_mm", "rms_mm", "radius_mm", "line_at_mm"})
"""Figures of the paper, in bold."""


Language = Literal["en", "de", "ko"]
LANGUAGES: tuple[Language, ...] = get_args(Language)


class Phrase(str):
    """A text with its key and the keys of the texts inserted into it, which tests and the JSON show."""

    __slots__ = ("keys",)
    keys: tuple[str, ...]

    def __new__(cls, text: str, keys: tuple[str, ...] = ()) -> Phrase:
        sentence = super().__new__(cls, text)
        sentence.keys = keys
        return sentence

    def __getnewargs__(self) -> tuple[str, tuple[str, ...]]:  # type: ignore[override]
        return str(self), self.keys


def keys_of(text: object) -> tuple[str, ...]:
    return text.keys if isinstance(text, Phrase) else ()


def capital(text: str) -> Phrase:
    return Phrase(f"{text[:1].upper()}{text[1:]}", keys_of(text))


def joined(texts: Iterable[str], by: str = " ") -> Phrase:
    shown = [text for text in texts if text]
    return Phrase(by.join(shown), tuple(key for text in shown for key in keys_of(text)))


def extended(sentence: str, words: str, form: str) -> str:
    """A sentence with words before its full stop; `form` shows both."""
    keys = (*keys_of(sentence), *keys_of(words))
    return Phrase(form.format(sentence.removesuffix("."), words), keys) if words else sentence


@dataclass(frozen=True)
class Texts:
    """nouns: only of effects whose standard name this language replaces."""

    language: Language
    words: dict[str, str]
    labels: dict[str, str]
    nouns: dict[str, str]

    def __call__(self, *keys: str, **values: object) -> Phrase:
        """Text with inserted values. Of several keys, the first that has a text is used."""
        key = next((key for key in keys if key in self.words), keys[-1])
        inner = (inner for value in values.values() for inner in keys_of(value))
        return Phrase(self.words[key].format(**values), (key, *inner))

    def counted(self, key: str, count: int, **values: object) -> str:
        return self(f"{key}_single" if count == 1 else key, key, count=count, **values)

    def test(self, name: str) -> str:
        return self.words.get(f"test_{name}", name)

    def not_known(self, share: float) -> str:
        """The sentence about the share of the work with unknown accuracy; empty for 0."""
        key = "work_unknown_all" if share == 1 else "work_unknown"
        return self(key, share=f"{max(100 * share, 1):.0f} %") if share else ""

    def axis(self, robot: Robot, axis: int) -> str:
        """`axis 4 (gamma)`, counted from 1."""
        name = robot.own_name(axis)
        return self("axis_of", axis=axis, name=name) if name else self("axis_numbered", axis=axis)

    def label(self, name: str) -> str:
        return self.labels.get(name) or ENGLISH.labels.get(name, name)

    def whole_label(self, name: str) -> str:
        """Label outside a table, a detail after the main line: `position error, largest`."""
        text = self.label(name)
        if not text.startswith(" "):
            return text
        known = list(ENGLISH.labels)
        above = next(main for main in known[known.index(name) :: -1] if not self.label(main).startswith(" "))
        # The place of the largest value is a detail of that line; a mean belongs to the rms.
        of = self.label(above) if name.endswith("_at_deg") else self.label(above).partition(", ")[0]
        return f"{of}, {text.strip()}"


@cache
def texts_of(language: Language) -> Texts:
    read = _template(f"texts.{language}")
    return Texts(language, _template("english") | read["words"], read["labels"], read["nouns"])


def _template(name: str) -> dict[str, Any]:
    file = resources.files("analysis") / "templates" / f"{name}.yaml"
    # a text file of this package; the loader in C is ten times faster
    loaded: dict[str, Any] = yaml.load(file.read_text("utf-8"), getattr(yaml, "CSafeLoader", yaml.SafeLoader))  # noqa: S506
    return loaded


ENGLISH = texts_of("en")


def in_order(names: Iterable[str]) -> list[str]:
    """Distinct names in the order of the labels, unknown ones last."""
    place = {name: k for k, name in enumerate(ENGLISH.labels)}
    return sorted(dict.fromkeys(names), key=lambda name: place.get(name, len(place)))
