"""The words of an answer, for tests that look for a key, a name or a figure in it."""

from __future__ import annotations

from collections.abc import Sequence

from analysis.apps.report.act_words import ActWords, without_idle_mounts
from analysis.apps.report.blocks import Block, Figure, Heading, Segments, Table
from analysis.apps.report.texts import Texts
from analysis.diagnosis.judge.result import Diagnosis


def words_of(blocks: Sequence[Block]) -> list[str]:
    """Return the text of each heading, sentence and command, and of each row of a table."""
    words = []
    for block in blocks:
        match block:
            case Heading():
                words.append(block.text)
            case Table():
                words += [" ".join(text for cell in row for text in (cell.text, *cell.below)) for row in block.cells()]
            case Segments() | Figure():
                pass
            case _:
                words.append(block.words)
    return words


def acts_in_words(diagnosis: Diagnosis, texts: Texts) -> list[str]:
    """Return the acts of a diagnosis as sentences in order of priority."""
    words = ActWords(diagnosis, texts)
    return [words.sentence(act) for act in without_idle_mounts(diagnosis.acts)]
