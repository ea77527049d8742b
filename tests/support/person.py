"""An emulated user at a terminal who answers questions. The pressed keys are counted."""

from __future__ import annotations

from tests.support.live_terminal import Terminal


class Person:
    """The user, and all keys pressed so far, including Enter."""

    def __init__(self, terminal: Terminal) -> None:
        self.terminal = terminal
        self.keys = 0

    def asked(self, question: str) -> None:
        def shown(text: str) -> bool:
            if self.terminal.process.poll() is not None and self.terminal.process.stderr:
                raise AssertionError(f"{question}\n{text}\n{self.terminal.process.stderr.read()!r}")
            return question in text.replace("\n", "")

        self.terminal.until(shown, question)

    def types(self, answer: str) -> None:
        self.keys += len(answer) + 1
        self.terminal.type(answer + "\n")

    def answers(self, question: str, answer: str) -> None:
        self.asked(question)
        self.types(answer)
