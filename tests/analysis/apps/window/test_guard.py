import pytest

from analysis.apps.window.guard import COOKIE, is_loopback, token_of
from analysis.apps.window.serve import listening
from rigs.errors import FileError, UseError
from tests.support.refusals import refused
from tests.support.windows import served

TOKEN = "-".join(("correct", "horse", "battery", "staple"))


@pytest.fixture(scope="module")
def open_one(tmp_path_factory):
    with served(tmp_path_factory.mktemp("open"), control=True) as one:
        yield one


@pytest.fixture(scope="module")
def closed(tmp_path_factory):
    with served(tmp_path_factory.mktemp("closed"), token=TOKEN, control=True) as one:
        yield one


@pytest.mark.parametrize(
    ("host", "status"),
    [
        ("evil.example", 400),
        ("127.0.0.1.evil.example", 400),
        ("", 400),
        ("[::2]", 400),
        ("127.0.0.1:80", 200),
        ("LOCALHOST:80", 200),
        ("[::1]:80", 200),
        ("cell.plant", 200),
    ],
)
def test_only_the_names_of_the_window_are_answered(open_one, host, status):
    assert open_one.ask("/", Host=host).status == status


def test_a_form_without_the_secret_controls_nothing(open_one):
    for body in ("", "secret=", "secret=wrong", b"\xff\xfe=\xff&secret=\xff"):
        assert open_one.post("/control/zero", body).status == 403
    assert open_one.post("/control/zero", f"secret={open_one.window.gate.secret}").status == 200
    assert open_one.ask("/control/zero").status == 405


def test_without_control_nothing_is_controlled(tmp_path):
    with served(tmp_path) as one:
        assert one.window.gate.secret not in one.ask("/").text
        assert one.post("/control/zero", f"secret={one.window.gate.secret}").status == 403
        with refused("port.in_use", "while attempting to bind on address"):
            listening("127.0.0.1", one.port)


def test_nothing_is_shown_without_the_token(closed):
    for path in ("/", "/events", "/report?run=x", "/runs/x/table.csv", "/made/0/page.html", f"/runs?token={TOKEN}"):
        assert closed.ask(path).status == 401, path
        page = closed.ask(path, Accept="text/html")
        assert (page.status, page.headers.get("location")) == (303, "/login"), path
    for given in ("Bearer wrong", f"Basic {TOKEN}", f"Bearer {TOKEN}x", "Bearer"):
        assert closed.ask("/runs", Authorization=given).status == 401, given
    for cookie in (f"{COOKIE}={TOKEN}", f"{COOKIE}=", "a=b; \x01", f"{COOKIE}"):
        assert closed.ask("/runs", Cookie=cookie).status == 401, cookie
    assert closed.post("/control/zero", f"secret={closed.window.gate.secret}").status == 401


def test_the_token_opens_the_window_and_is_in_no_cookie(closed):
    assert closed.ask("/runs", Authorization=f"Bearer {TOKEN}").status == 200
    wrong = closed.post("/login", "token=wrong")
    assert wrong.status == 403 and "set-cookie" not in wrong.headers
    right = closed.post("/login", f"token={TOKEN}")
    cookie = right.headers["set-cookie"]
    assert right.headers["location"] == "/" and TOKEN not in cookie
    assert "httponly" in cookie.lower() and "samesite=strict" in cookie.lower()
    assert closed.ask("/runs", Cookie=cookie.partition(";")[0]).status == 200
    assert closed.ask("/static/window.css").status == 200  # the page to sign in has its style


@pytest.mark.parametrize("path", ["/", "/nowhere", "/static/window.js"])
def test_a_page_loads_nothing_from_elsewhere_and_stands_in_no_frame(open_one, path):
    headers = open_one.ask(path).headers
    policy = headers["content-security-policy"]
    assert "default-src 'none'" in policy and "unsafe" not in policy and "frame-ancestors 'none'" in policy
    assert headers["x-content-type-options"] == "nosniff" and "server" not in headers


def test_choice_of_language_stays_in_the_window(open_one):
    for back in ("http://evil.example", "//evil.example", "/\\evil.example", "javascript:alert(1)"):
        location = open_one.post("/language", f"to=de&back={back}").headers["location"]
        assert location[0] == "/" and location[1] not in "/\\"
    answer = open_one.post("/language", "to=de&back=/runs?q=a")
    assert answer.headers["location"] == "/runs?q=a"
    assert "Läufe" in open_one.ask("/runs", Cookie=answer.headers["set-cookie"].partition(";")[0]).text
    assert "측정" in open_one.ask("/runs", Accept_Language="fr, ko-KR;q=0.8, de").text


def test_a_token_file_contains_one_long_word(tmp_path):
    file = tmp_path / "token"
    for text in ("short", "two words, eighteen", "x" * 2000, "töken-of-some-letters", ""):
        file.write_text(text)
        with pytest.raises(FileError):
            token_of(file)
    file.write_text(f"{TOKEN}\n")
    assert token_of(file) == TOKEN
    with refused("file.unreadable", "No such file or directory"):
        token_of(tmp_path / "none")


def test_only_addresses_of_this_computer_need_no_token():
    assert is_loopback("127.0.0.1") and is_loopback("::1") and not is_loopback("192.168.1.5") and not is_loopback("::")
    with pytest.raises(UseError):
        is_loopback("cell.plant")
