"""Write the manual pages rig.1 and rigd.8 from the commands' own help: `scripts/dev man_pages DIRECTORY`."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path
from typing import Annotated, Any

import typer

from analysis.cli import app
from daq.service.rigd import app as daemon
from rigs.distribution import NAME

EXIT_CODES = {
    0: "success",
    1: "doctor found a problem, certify does not accept a feature, or an internal error",
    2: "wrong usage",
    3: "a file is missing, damaged or wrong",
    4: "the cell or the computer fails",
    130: "Ctrl-C",
}


def main(folder: Annotated[Path, typer.Argument(metavar="DIRECTORY")]) -> None:
    """Write rig.1 and rigd.8 into DIRECTORY."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "rig.1").write_text(page_of_rig(), encoding="utf-8")
    (folder / "rigd.8").write_text(page_of_rigd(), encoding="utf-8")


def page_of_rig() -> str:
    """Manual page of `rig`: its commands by task."""
    command: Any = typer.main.get_command(app)
    by_task: dict[str, list[Any]] = defaultdict(list)
    for each in command.commands.values():
        if not each.hidden:
            by_task[each.rich_help_panel if isinstance(each.rich_help_panel, str) else "Other"].append(each)
    lines = [*_head("rig", 1, command.help), *_section("SYNOPSIS", r"\fBrig\fR \fICOMMAND\fR [\fIOPTIONS\fR]")]
    lines += _section("COMMANDS", "rig COMMAND \\-\\-help describes every option.")
    for task, commands in by_task.items():
        lines.append(f".SS {_plain(task)}")
        for each in commands:
            lines += [".TP", rf"\fB{_plain(each.name)}\fR", _plain(each.help.split("\n\n")[0])]
    lines += _section("EXIT STATUS")
    for code, meaning in EXIT_CODES.items():
        lines += [".TP", rf"\fB{code}\fR", _plain(meaning)]
    return "\n".join([*lines, *_section("SEE ALSO", r"\fBrigd\fR(8)")]) + "\n"


def page_of_rigd() -> str:
    """Manual page of `rigd`: its options and files."""
    command: Any = typer.main.get_command(daemon)
    lines = [*_head("rigd", 8, command.help), *_section("SYNOPSIS", r"\fBrigd\fR [\fIOPTIONS\fR] \fIRIG\fR")]
    lines += _section("OPTIONS")
    for option in command.params:
        if option.param_type_name == "option":
            lines += [".TP", rf"\fB{_plain(', '.join(option.opts))}\fR", _plain(option.help or "")]
    lines += _section("FILES")
    for path, meaning in (("/etc/rig/NAME.yaml", "rig file of rigd@NAME"), ("/var/lib/rigd-NAME/runs", "its runs")):
        lines += [".TP", rf"\fI{path}\fR", _plain(meaning)]
    return "\n".join([*lines, *_section("SEE ALSO", r"\fBrig\fR(1), \fBsystemctl\fR(1)")]) + "\n"


def _head(name: str, section: int, help_text: str) -> list[str]:
    summary = " ".join(help_text.split("\n\n", maxsplit=1)[0].split())
    title = f'.TH {name.upper()} {section} "" "{NAME}"'
    return [title, *_section("NAME", rf"{name} \- {_plain(summary)}")]


def _section(title: str, *text: str) -> list[str]:
    return [f".SH {title}", *text]


def _plain(text: str) -> str:
    """Text on one line, with the characters that roff interprets escaped."""
    line = " ".join(text.split()).replace("\\", r"\e").replace("-", r"\-")
    return rf"\&{line}" if line.startswith((".", "'")) else line


if __name__ == "__main__":
    typer.run(main)
