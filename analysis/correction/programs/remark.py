"""A remark at the end of a program, in the words and at the place that its language allows.

Sources: as for the dialects' readers. A remark of a pendant has at most 32 characters (FANUC B-83284EN, 4.13; Yaskawa
RE-CKI-A457), so a longer one takes several lines.
"""

from __future__ import annotations

import re
import textwrap

_PENDANT = 32
"""Characters of a remark at the pendants of FANUC and Yaskawa."""
_LONGEST = 100
_BEFORE = {
    ".mod": re.compile(rb"^[ \t]*ENDMODULE\b", re.MULTILINE | re.IGNORECASE),
    ".dat": re.compile(rb"^[ \t]*ENDDAT\b", re.MULTILINE | re.IGNORECASE),
    ".ls": re.compile(rb"^/POS\b", re.MULTILINE),
    ".jbi": re.compile(rb"^[ \t]*END\b", re.MULTILINE),
}
"""What the remark stands before, in its last place in the file; it is the last line of other files."""
_NUMBERED = re.compile(rb"^[ \t]*(\d+):", re.MULTILINE)


def with_remark(name: str, data: bytes, remark: str) -> bytes:
    """Return the bytes of a program's file, by its name, with a remark in lines of their own; all else stays."""
    suffix = name[name.rfind(".") :].lower()
    returns = b"\r\n" if b"\r\n" in data else b"\r" if b"\r" in data and b"\n" not in data else b"\n"
    places = (
        [match.start() for match in _BEFORE[suffix].finditer(data.replace(b"\r", b"\n"))] if suffix in _BEFORE else []
    )
    at = places[-1] if places else len(data)
    lines = textwrap.wrap(remark, _PENDANT if suffix in (".ls", ".jbi") else _LONGEST)
    number = max([int(match[1][:9]) for match in _NUMBERED.finditer(data[:at].replace(b"\r", b"\n"))], default=0)
    begins = {".ls": "{:4d}:  !", ".jbi": "'", ".mod": "  ! ", ".script": "# ", ".urscript": "# "}
    begin = begins.get(suffix, "; ")
    remark_lines = [
        f"{begin.format(number + k)}{line}{' ;' if suffix == '.ls' else ''}" for k, line in enumerate(lines, start=1)
    ]
    whole = returns.join(line.encode("ascii") for line in remark_lines)
    if at == len(data) and data and not data.endswith((b"\n", b"\r")):
        return data + returns + whole
    return data[:at] + whole + returns + data[at:]
