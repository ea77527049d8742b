import re

import pytest

from tests.support.nightly import cases
from tests.trials.programs.trial import correct
from tests.worlds.languages.arms import DIALECTS
from tests.worlds.languages.grammars import draw

_N = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_SIX = r"\s*,\s*".join([_N] * 6)
_POSES = {
    "ur": rf"p\[\s*{_SIX}\s*\]",
    "kuka": rf"\{{[^{{}}\n]*X\s+{_N}[^{{}}\n]*\}}",
    "abb": rf"\[\s*\[\s*{_N}(?:\s*,\s*{_N}){{2}}\s*\]\s*,\s*\[\s*{_N}(?:\s*,\s*{_N}){{3}}\s*\]\s*,"
    r"\s*\[[^\[\]]*\]\s*,\s*\[",
    "fanuc": r"^\s*P\[\d+[^\]]*\]\s*\{",
    "yaskawa": r"^C\d+=.*",
}
_OTHERS = {
    "ur": r"^[ \t]*\$.*|#.*|\"[^\"\n]*\"|(?:set_tcp|force_mode|track_conveyor_\w+|path_offset_set)\([^\n]*"
    r"|\b(?:pose_trans|pose_add)\(\w+, p\[[^\]]*\]|\bpose_trans\(p\[[^\]]*\](?=, [A-Za-z_]\w*\))"
    r"|\b(?:tcp|plane|o)_\d+ = .*",
    "kuka": r";.*|\"[^\"\n]*\"|^.*(?:\$TOOL|\$BASE|TOOL_DATA|BASE_DATA|MACHINE_DEF).*$",
    "abb": r"!.*|\"[^\"\n]*\"|^.*\bPDispOn\b.*|^\s*\w+:=\[.*",
    "fanuc": r"^\s*\d*:\s*!.*",
    "yaskawa": r"^'.*",
}
"""Comments, texts, tools, frames and offsets. RAPID lists the declaration of a point that the program assigns again."""
_DRAWN, _AT_NIGHT = 8, 200
_PARTS = [(dialect, part) for part in range(_AT_NIGHT // _DRAWN) for dialect in DIALECTS]


@pytest.mark.parametrize(("dialect", "part"), cases(_PARTS, lambda one: one[1] == 0))
def test_every_pose_in_numbers_is_corrected_or_listed(dialect, part):
    others, count = re.compile(_OTHERS[dialect], re.MULTILINE), 0
    for seed in range(part * _DRAWN, (part + 1) * _DRAWN):
        draft = draw(dialect, seed, plain=False)
        corrected = correct(draft)
        said = {place for place, _ in corrected.left} | corrected.done
        for name in corrected.read:
            text = draft.files[name].decode("latin-1").replace("\r\n", "\n").replace("\r", "\n")
            text = others.sub(lambda match: " " * len(match[0]), text)
            for pose in re.finditer(_POSES[dialect], text, re.MULTILINE):
                first, last = (text.count("\n", 0, place) + 1 for place in (pose.start(), pose.end()))
                count += 1
                # The line of a statement, which may begin above its numbers
                assert said & {(name, line) for line in range(first - 1, last + 1)}, (seed, name, first, pose[0])
    assert count > _DRAWN
