"""The texts of the window in the languages of the report; what the analysis says in its own words stays English."""

from __future__ import annotations

from functools import cache
from importlib import resources

import yaml

from analysis.reporting.texts import LANGUAGES, Language

NAMES: dict[Language, str] = {"en": "English", "de": "Deutsch", "ko": "한국어"}


@cache
def texts_of(language: Language) -> dict[str, str]:
    """Return the texts of a language by key."""
    file = resources.files("analysis") / "templates" / "window" / f"texts.{language}.yaml"
    words: dict[str, str] = yaml.safe_load(file.read_text(encoding="utf-8"))
    return words


def language_of(chosen: str, accepted: str) -> Language:
    """Return the language that a person has chosen, else the first of those that the browser accepts (RFC 9110,
    12.5.4, in their order), else English."""
    for tag in (chosen, *(part.partition(";")[0].strip() for part in accepted[:200].split(","))):
        for language in LANGUAGES:
            if tag.lower().partition("-")[0] == language:
                return language
    return "en"
