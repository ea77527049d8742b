import pytest

from analysis.apps.makers import maker_by
from analysis.apps.makers.reading import mark_of, refuse_marked, with_remark
from analysis.correction.support import ANYWAY
from rigs.errors import FileError
from tests.trials.programs.trial import MACHINES, reached
from tests.worlds.languages.arms import DIALECTS
from tests.worlds.languages.execution import Ways, World
from tests.worlds.languages.grammars import draw

_BEGINS = {"ur": b"# ", "kuka": b"; ", "abb": b"  ! ", "fanuc": b"  !", "yaskawa": b"'"}


def _words(lines: list[bytes]) -> str:
    return " ".join(line.lstrip(b"0123456789: ").strip(b" #;!'").decode() for line in lines)


@pytest.mark.parametrize("dialect", DIALECTS)
@pytest.mark.parametrize("ends", [b"\n", b"\r\n"])
def test_a_remark_is_lines_of_its_own(dialect, ends):
    for name, data in draw(dialect, 1, plain=True).files.items():
        before = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n").replace(b"\n", ends)
        old, new = before.split(ends), with_remark(maker_by(dialect).reader.remark, name, before, ANYWAY).split(ends)
        at = next((k for k, line in enumerate(old) if new[k] != line), len(old))
        own = new[at : at + len(new) - len(old)]
        assert new == [*old[:at], *own, *old[at:]] and _words(own) == ANYWAY
        assert all(_BEGINS[dialect] in line for line in own)
        if dialect in ("fanuc", "yaskawa"):  # the pendants' limit
            assert max(len(line.partition(_BEGINS[dialect])[2].rstrip(b" ;")) for line in own) <= 32


@pytest.mark.parametrize("dialect", DIALECTS)
def test_program_with_a_remark_behaves_unchanged(dialect):
    draft = draw(dialect, 2, plain=True)
    ways = []
    for files in (
        draft.files,
        {name: with_remark(maker_by(dialect).reader.remark, name, data, ANYWAY) for name, data in draft.files.items()},
    ):
        program = MACHINES[dialect].Program({name: data.decode("latin-1") for name, data in files.items()}, draft.main)
        world = World(0, {("tool", name.lower()): T for name, T in draft.tools.items()})
        ways.append([(one.place, one.q.tolist()) for one in reached(draft, program, world, Ways())])
    assert ways[0] and [q for _, q in ways[0]] == [q for _, q in ways[1]]


def test_a_last_line_without_an_end_gets_one():
    assert with_remark(maker_by("ur").reader.remark, "a.script", b"movej(q)", "mind") == b"movej(q)\n# mind"
    assert with_remark(maker_by("ur").reader.remark, "a.script", b"movej(q)\r", "mind") == b"movej(q)\r# mind\r"
    assert (
        with_remark(maker_by("yaskawa").reader.remark, "a.jbi", b"NOP\r\nEND\r\n", "mind") == b"NOP\r\n'mind\r\nEND\r\n"
    )


@pytest.mark.parametrize("dialect", DIALECTS)
def test_marked_program_is_refused(dialect, tmp_path):
    draft = draw(dialect, 3, plain=True)
    path, data = tmp_path / draft.main, draft.files[draft.main]
    path.write_bytes(data)
    refuse_marked(path)
    marked = with_remark(maker_by(dialect).reader.remark, draft.main, data, mark_of("2026-11-27"))
    path.write_bytes(marked)
    line = 1 + next(k for k, line in enumerate(marked.splitlines()) if b"corrected by rig" in line)
    with pytest.raises(FileError, match=f"{path.name}:{line}:"):
        refuse_marked(path)
