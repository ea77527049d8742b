import re
from functools import lru_cache

import pytest

from analysis.apps.makers import maker_by, maker_of_file
from analysis.apps.makers.emulated import ProgramError
from analysis.apps.programs.planned import plans_of
from rigs.makers import MAKERS
from rigs.schema.vocabulary import MakerName
from tests.support.every import for_every_maker
from tests.worlds.interpreters.arms import rig_of
from tests.worlds.interpreters.driven import files_of, run

MARKS = {
    "ur": [r"\(", r"\)", r",", r"\[", r"\]", r":\n", r"=", r"\nend\n", r"movec", r"def ", r"\n[a-z]\w+\(\)\n"],
    "fanuc": [r" ;", r"\[", r"\]", r"\};", r",\t", r"mm/sec", r" deg", r"/POS", r"/END", r"P\[1\]\{", r"FINE", r" 10:"],
    "kuka": [r"\nEND", r"DEF ", r"CIRC ", r", P", r"\}", r"\{", r"WAIT SEC", r"#PATH", r"\$ROBROOT"],
    "abb": [r";", r":=", r"\[", r"\]", r"MoveC", r"ENDPROC", r"ENDMODULE", r"MODULE ", r"\\WObj", r"PROC ", r"LOCAL "],
    "yaskawa": [
        r"END",
        r"NOP",
        r"V=",
        r"MOVC ",
        r"C0",
        r"//INST",
        r"///RCONF",
        r"\.",
        r"///NPOS \d+",
        r"TIMER T=",
        r",RJ",
    ],
}
"""Left out, one at a time."""


@lru_cache
def program(dialect: MakerName) -> dict[str, str]:
    return files_of(dialect, plans_of(rig_of("ur10e"), "yaw", 3.0)[0])


@pytest.mark.parametrize(
    ("dialect", "mark"), [(dialect, mark) for dialect in MAKERS for mark in MARKS.get(dialect, ())]
)
def test_a_missing_mark_is_refused(dialect, mark):
    files = program(dialect)
    name = next(filter(maker_of_file, files))
    newline = maker_by(dialect).writer.newline
    text = files[name].replace(newline, "\n")
    places = [found.span() for found in re.finditer(mark, text) if not _in_comment(text, found.start(), dialect)]
    assert places, mark
    for begin, end in (places[0], places[len(places) // 2], places[-1]):
        slipped = (text[:begin] + text[end:]).replace("\n", newline)
        with pytest.raises(ProgramError):
            run(dialect, files | {name: slipped}, rig_of("ur10e"))


def _in_comment(text: str, at: int, dialect: str) -> bool:
    line = text[text.rfind("\n", 0, at) + 1 : at]
    return {"ur": "#", "fanuc": "!", "kuka": ";", "abb": "!", "yaskawa": "'"}[dialect] in line


@for_every_maker
def test_the_program_without_a_slip_is_taken(dialect):
    assert run(dialect, program(dialect), rig_of("ur10e"))


def test_a_semicolon_ends_a_line_of_a_teach_pendant_program():
    files = program("fanuc")
    (name,) = files
    with pytest.raises(ProgramError):
        run("fanuc", {name: files[name].replace("!CHECK:", "!CHECK;", 1)}, rig_of("ur10e"))


def test_a_point_of_the_data_list_that_is_missing_is_refused():
    files = program("kuka")
    name = next(name for name in files if name.endswith(".dat"))
    for slip in (r"DECL FRAME P0002 [^\n]*\n", r"A1 ", r"ENDDAT", r"\}"):
        slipped = re.sub(slip, "", files[name], count=1)
        assert slipped != files[name]
        with pytest.raises(ProgramError):
            run("kuka", files | {name: slipped}, rig_of("ur10e"))
