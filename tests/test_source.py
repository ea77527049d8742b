"""What the source says of itself: docstrings with shapes, units and plain words, numbers with their origin,
constructors that do no work, effects that only their own files name, and tests with a reason for each private name."""

from __future__ import annotations

import ast
import io
import re
import tokenize
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from rigs.effects import VOCABULARY

ROOT = Path(__file__).parents[1]
PACKAGES = ("rigs", "daq", "analysis")
FILES = [path for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py"))]


@cache
def tree_of(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def nodes_of(path: Path) -> tuple[ast.AST, ...]:
    """Every node of a file: walking through all of them costs more than what most tests here look for."""
    return tuple(ast.walk(tree_of(path)))


def name_of(path: Path) -> str:
    return str(path.relative_to(ROOT))


# --- docstrings and messages

ARRAY = re.compile(r"\b(Array|NDArray|ndarray|Integers|Mask)\b")
SHAPE = re.compile(r"\((?:\.\.\.|…|\d|[A-Za-z])[\w\s.+·*/…-]*,[^()]*\)|\(\d\)")
"""`(n,)`, `(n, 6)`, `(..., NODES)`, `(6)`."""
UNIT = re.compile(
    r"(?<!\w)(mm|rad|deg|degrees|s|ns|Hz|Nm|ppm|relative|ratio|shares?|weights?|turns?|standard deviations?|poses?"
    r"|whitened|healthy sizes?|log evidence|µm|mm²|counts?|numbers?|index|indices|mask|whether|which|directions?"
    r"|orders?|power|units?|sum|figures)(?!\w)|°|_(mm|rad|deg|s|ns|um)\b"
)
"""A unit, or a word for what has none, as a share, a number, a mask, or whitened values (standard deviations)."""


def _functions() -> Iterator[tuple[str, ast.FunctionDef, str]]:
    """Each public function on arrays: its place, itself, and the words that describe it."""
    for path in FILES:
        name = name_of(path)
        for node in nodes_of(path):
            bodies = [("", node)] if isinstance(node, ast.Module) else []
            bodies += [(ast.get_docstring(node) or "", node)] if isinstance(node, ast.ClassDef) else []
            for of_class, body in bodies:
                inherited = _inherited(body) if isinstance(body, ast.ClassDef) else set()
                for one in body.body:
                    if not isinstance(one, ast.FunctionDef) or one.name.startswith("_") or one.name in inherited:
                        continue
                    if _on_arrays(one):
                        yield f"{name}:{one.name}", one, _words(one, of_class)


@cache
def _classes() -> dict[str, ast.ClassDef]:
    """The classes of the product by name."""
    return {node.name: node for path in FILES for node in nodes_of(path) if isinstance(node, ast.ClassDef)}


def _inherited(of_class: ast.ClassDef) -> set[str]:
    """Return the methods whose docstrings are in a base class."""
    names = {ast.unparse(base).partition("[")[0] for base in of_class.bases}
    above = [_classes()[name] for name in names if name in _classes() and name != of_class.name]
    methods = [one for body in above for one in body.body if isinstance(one, ast.FunctionDef)]
    return {one.name for one in methods if ast.get_docstring(one)}.union(*map(_inherited, above))


def _arrays(one: ast.FunctionDef) -> list[ast.arg]:
    arguments = [*one.args.args, *one.args.kwonlyargs]
    return [each for each in arguments if each.annotation and ARRAY.search(ast.unparse(each.annotation))]


def _on_arrays(one: ast.FunctionDef) -> bool:
    return bool(_arrays(one)) or bool(one.returns and ARRAY.search(ast.unparse(one.returns)))


def _words(one: ast.FunctionDef, of_class: str) -> str:
    """What a reader sees: the docstring and the names; of a property also the docstring of its class."""
    is_property = any(ast.unparse(decorator).endswith("property") for decorator in one.decorator_list)
    names = " ".join([one.name, *(each.arg for each in _arrays(one))])
    return f"{ast.get_docstring(one) or ''} {of_class if is_property else ''} {names}"


FRAGMENT = re.compile(r"(Of|By|That|In which|In the|As (for|in)|Beside|Times (the|what|a|as)) ")
"""Beginnings of docstrings that omit the subject: `Of a cycle: …`."""
QUAINT = re.compile(r"\b(tells?|told|nobody|whoever|anew|awaited|no doubt|mended?)\b", re.I)
"""Words for which this project has plainer ones: report, distinguish, unknown, again, correct."""


def _strings() -> Iterator[tuple[str, str]]:
    """Each docstring and message of the product with its place."""
    for path in FILES:
        name = name_of(path)
        for node in nodes_of(path):
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value:
                yield f"{name}:{node.lineno}", node.value


def test_shapes_and_units_are_said() -> None:
    functions = list(_functions())
    assert len(functions) > 100
    places = {f"{place}, line {one.lineno}": words for place, one, words in functions}
    assert [at for at, words in places.items() if not SHAPE.search(words)] == [], (
        "no docstring gives a shape, as (n, 6)"
    )
    assert [at for at, words in places.items() if not UNIT.search(words)] == [], "neither docstring nor names: a unit"


def test_docstrings_name_their_subject_and_words_are_plain() -> None:
    strings = list(_strings())
    assert len(strings) > 2000
    assert [(place, text[:60]) for place, text in strings if FRAGMENT.match(text) or QUAINT.search(text)] == []


@pytest.mark.parametrize(
    ("words", "shape", "unit"),
    [
        ("Angles (n,) rad.", True, True),
        ("Curves (..., NODES).", True, False),
        ("Angles of the joints (see there), in rad.", False, True),
        ("The T of an arm.", False, False),
    ],
)
def test_what_counts_as_shape_and_unit(words: str, shape: bool, unit: bool) -> None:
    assert (bool(SHAPE.search(words)), bool(UNIT.search(words))) == (shape, unit)


# --- numbers of the estimating folders


def constants(tree: ast.Module) -> Iterator[tuple[str, int, bool]]:
    """Name, first line and whether a docstring follows, of each module-level assignment with a number in it."""
    for node, following in zip(tree.body, [*tree.body[1:], None], strict=True):
        if not isinstance(node, ast.Assign | ast.AnnAssign) or node.value is None or not _has_number(node.value):
            continue
        target = node.targets[0] if isinstance(node, ast.Assign) else node.target
        documented = isinstance(following, ast.Expr) and isinstance(following.value, ast.Constant)
        yield ast.unparse(target), node.lineno, documented and isinstance(following.value.value, str)


def _has_number(value: ast.expr) -> bool:
    parts = (part.value for part in ast.walk(value) if isinstance(part, ast.Constant))
    return any(isinstance(part, int | float) and not isinstance(part, bool) for part in parts)


def without_origin(text: str) -> list[str]:
    """Numeric constants that neither a docstring follows nor a comment precedes."""
    lines = text.splitlines()
    return [
        name
        for name, line, documented in constants(ast.parse(text))
        if not documented and not lines[line - 2].startswith("#")
    ]


def test_each_constant_states_its_origin() -> None:
    folders = ("diagnosis", "runs/noise", "correction")
    files = [file for folder in folders for file in sorted((ROOT / "analysis" / folder).rglob("[!_]*.py"))]
    files += [ROOT / "analysis" / "apps" / "commission" / f"{name}.py" for name in ("driven_circle", "touched_ball")]
    assert len(files) > 50
    found = {name_of(file): without_origin(file.read_text(encoding="utf-8")) for file in files}
    assert {name: missing for name, missing in found.items() if missing} == {}


def test_a_number_without_a_word_is_found() -> None:
    text = 'A = 1.0\nB, C = 2, 3\n"""Chosen."""\n# chosen\nD = [4]\nE = "text"\n'
    assert without_origin(text) == ["A"]


# --- constructors: files, sockets, processes and threads are opened by a classmethod or by `start`, which can fail and
# be undone, and what takes long is computed before

WORK = {
    *("open", "openpty", "socket", "create_server", "connect", "bind", "listen", "accept", "start", "submit", "Popen"),
    *("mkdir", "touch", "unlink", "symlink_to", "read_text", "read_bytes", "write_text", "write_bytes", "stat"),
    *("least_squares", "minimize", "sleep"),
}
"""Last names of calls that work."""
MADE = {"array", "asarray", "empty", "zeros", "ones", "full", "eye", "default_rng"}
"""numpy functions that create arrays without computation. All other numpy functions and matrix products compute."""


def working_constructors(source: str) -> dict[str, set[str]]:
    """Return what the constructor of each class in a file calls that works, of classes that do."""
    tree = ast.parse(source)
    functions = {node.name: node for node in tree.body if isinstance(node, ast.FunctionDef)}
    found = {}
    for owner in (node for node in ast.walk(tree) if isinstance(node, ast.ClassDef)):
        methods = {node.name: node for node in owner.body if isinstance(node, ast.FunctionDef)}
        called = {
            name
            for constructor in ("__init__", "__post_init__")
            if constructor in methods
            for name in _called(methods[constructor], functions, methods, {constructor})
        }
        if works := {name for name in called if name in WORK or name == "@" or name.startswith("np.")}:
            found[owner.name] = works
    return found


def _called(
    function: ast.FunctionDef,
    functions: dict[str, ast.FunctionDef],
    methods: dict[str, ast.FunctionDef],
    seen: set[str],
) -> set[str]:
    """Return the last names of what a function calls, and what the functions and methods of the same file call."""
    names = {"@" for node in ast.walk(function) if isinstance(getattr(node, "op", None), ast.MatMult)}
    for call in (node for node in ast.walk(function) if isinstance(node, ast.Call)):
        called: ast.FunctionDef | None = None
        if isinstance(call.func, ast.Name):
            names.add(call.func.id)
            called = functions.get(call.func.id)
        elif isinstance(call.func, ast.Attribute):
            numpy = ast.unparse(call.func).startswith("np.") and call.func.attr not in MADE
            names.add(ast.unparse(call.func) if numpy else call.func.attr)
            if isinstance(call.func.value, ast.Name) and call.func.value.id == "self":
                called = methods.get(call.func.attr)
        if called is not None and called.name not in seen:
            seen.add(called.name)
            names |= _called(called, functions, methods, seen)
    return names


@pytest.mark.parametrize(
    ("body", "works"),
    [
        ("self._file = path.open()", {"open"}),
        ("self._begin()", {"start"}),
        ("self._line = _made()", {"openpty"}),
        ("self._lock = threading.Lock()", set()),
        ("self._places = np.zeros(3)", set()),
        ("self._whole = np.concatenate(path)", {"np.concatenate"}),
        ("self._basis = np.linalg.qr(path)[0]", {"np.linalg.qr"}),
        ("self._fitted = path.T @ path", {"@"}),
    ],
)
def test_a_constructor_that_works_is_found(body: str, works: set[str]) -> None:
    source = (
        f"class Port:\n    def __init__(self, path):\n        {body}\n"
        "    def _begin(self):\n        self._thread.start()\n"
        "def _made():\n    return os.openpty()\n"
    )
    assert working_constructors(source) == ({"Port": works} if works else {})


def test_no_constructor_works() -> None:
    found = {
        f"{name_of(path)}: {name}": works
        for path in FILES
        for name, works in working_constructors(path.read_text(encoding="utf-8")).items()
    }
    assert found == {}


# --- effects

CLASSES = {cls.__name__: name for name, cls in VOCABULARY.items()}
IDENTIFIERS = re.compile(rf"\b({'|'.join((*VOCABULARY, *CLASSES))})\b")
KEYS = re.compile(
    rf"\b({'|'.join(name for name in VOCABULARY if '_' in name)})\b"
    rf"|^({'|'.join(name for name in VOCABULARY if '_' not in name)})\b"
)
"""In a string; an English word, as vibration, only where the string begins with it."""


def _names_in(tree: ast.Module) -> set[str]:
    """Effects that code names by identifiers, imports and strings, docstrings left out."""
    prose = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    found: set[str] = set()
    for node in ast.walk(tree):
        match node:
            case ast.Constant(value=str(text)) if id(node) not in prose:
                found.update(name for groups in KEYS.findall(text) for name in groups if name)
            case (
                ast.Name(id=text)
                | ast.Attribute(attr=text)
                | ast.alias(name=text)
                | ast.keyword(arg=str(text))
                | ast.ImportFrom(module=str(text))
            ):
                found.update(IDENTIFIERS.findall(text))
    return {CLASSES.get(name, name) for name in found}


def test_only_its_own_file_names_an_effect() -> None:
    """What another file knew of an effect would be missing of a new one."""
    own = {path: {path.stem} if path.parent.name == "effects" else set() for path in FILES}
    found = {name_of(path): _names_in(tree_of(path)) - own[path] for path in FILES}
    assert {name: effects for name, effects in found.items() if effects} == {}


def test_names_are_found_where_code_holds_them() -> None:
    assert _names_in(ast.parse('"""A vibration."""\nX = {"time_lag": 1}')) == {"time_lag"}
    assert _names_in(ast.parse("from rigs.effects import Backlash as B")) == {"backlash"}
    assert _names_in(ast.parse("import rigs.effects.ball_form")) == {"ball_form"}
    assert _names_in(ast.parse("effects.ServoLag(axis=1)")) == {"servo_lag"}
    assert _names_in(ast.parse('tell("the vibration of the stand")')) == set()


# --- tests that reach into private names say why, so that it is known which break when code moves: in a comment on the
# line or the one above, `# private: why`, or once for a file and a name, `# private _name, _other: why`

DOCUMENTED = {"_exit", "_replace", "_asdict", "_fields"}
"""`os._exit`, and the methods of named tuples."""
REASON = re.compile(r"# private(?P<names>( _\w+,?)*): \w.*")


def private_names(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Yield line and name of each access to a private name of another object or module."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute):
            if not (isinstance(node.value, ast.Name) and node.value.id in ("self", "cls")):
                yield node.end_lineno or node.lineno, node.attr
        elif isinstance(node, ast.ImportFrom):
            yield from ((alias.lineno, part) for alias in node.names for part in _parts(node.module, alias.name))
        elif isinstance(node, ast.Import):
            yield from ((alias.lineno, part) for alias in node.names for part in alias.name.split("."))
        elif isinstance(node, ast.Call) and ast.unparse(node.func).endswith(("setattr", "getattr", "delattr")):
            named = [one for one in node.args[:2] if isinstance(one, ast.Constant) and isinstance(one.value, str)]
            yield from ((one.lineno, str(one.value).rsplit(".", 1)[-1]) for one in named)


def _parts(module: str | None, name: str) -> list[str]:
    return [*(module or "").split("."), name]


def unexplained(source: str) -> list[str]:
    """Return `line: name` of each access to a private name without a reason."""
    reasons = {
        token.start[0]: match
        for token in tokenize.generate_tokens(io.StringIO(source).readline)
        if token.type == tokenize.COMMENT and (match := REASON.search(token.string))
    }
    of_file = {name.strip(" ,") for match in reasons.values() for name in match["names"].split()}
    of_line = {line for line, match in reasons.items() if not match["names"]}
    return [
        f"{line}: {name}"
        for line, name in private_names(ast.parse(source))
        if re.fullmatch(r"_[^_]\w*", name) and name not in DOCUMENTED | of_file and not {line, line - 1} & of_line
    ]


@pytest.mark.parametrize(
    ("source", "found"),
    [
        ("one._state", ["1: _state"]),
        ("one._state  # private: it is not reported", []),
        ("# private: it is not reported\none._state", []),
        ("# private _state, _io: stepped by hand\n\none._state + one._io + one._run", ["3: _run"]),
        ("one._state  # private:", ["1: _state"]),
        ("self._state + cls._state + one.__doc__ + os._exit", []),
        ("from a._b import _c", ["1: _b", "1: _c"]),
        ("import a._b", ["1: _b"]),
        ("monkeypatch.setattr(one, '_ROOM', 3)\nmonkeypatch.setattr('a.b._ROOM', 3)", ["1: _ROOM", "2: _ROOM"]),
    ],
)
def test_an_access_without_a_reason_is_found(source: str, found: list[str]) -> None:
    assert unexplained(source) == found


def test_every_access_to_a_private_name_gives_its_reason() -> None:
    missing = [
        f"{name_of(path)}:{access}"
        for path in sorted((ROOT / "tests").rglob("*.py"))
        for access in unexplained(path.read_text(encoding="utf-8"))
    ]
    assert not missing, "\n".join(missing)


# --- numbers


def test_a_signed_number_never_shows_a_negative_zero() -> None:
    """The point of a movement was `+1.60, +0.19, -0.00 mm`: a format with a sign also has the option z of PEP 682."""
    wire = {"daq/apps/gauge_drivers/magnescale_lt.py", "daq/acquisition/capture_writer.py"}  # formats of other programs
    signed, bare = re.compile(r"\+z[\d.{}]*[fg%]?"), re.compile(r"\+0?[\d.{}]*[fg%]")
    specs = [
        (name_of(path), spec)
        for path in FILES
        for node in nodes_of(path)
        if isinstance(node, ast.JoinedStr)
        for value in node.values
        if isinstance(value, ast.FormattedValue) and value.format_spec is not None
        for spec in [ast.unparse(value.format_spec).removeprefix("f'").removesuffix("'")]
    ]
    assert sum(bool(signed.fullmatch(spec)) for _, spec in specs) > 30
    assert [entry for entry in specs if bare.fullmatch(entry[1]) and entry[0] not in wire] == []
