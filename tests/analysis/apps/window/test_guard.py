"""Who is let in: hosts, origins, tokens, forms, and what a browser may do with a page."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from analysis.apps.window.guard import COOKIE, Gate, is_loopback, token_of
from rigs.errors import FileError, UseError
from tests.support.windows import Served, served

TOKEN = "-".join(("correct", "horse", "battery", "staple"))
PAGES = ("/", "/session", "/runs", "/events", "/fleet", "/report?run=x", "/runs/x/table.csv", "/made/0/page.html")


@pytest.fixture(scope="module")
def open_one(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with served(tmp_path_factory.mktemp("open"), control=True) as one:
        yield one


@pytest.fixture(scope="module")
def closed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with served(tmp_path_factory.mktemp("closed"), token=TOKEN, control=True) as one:
        yield one


@pytest.mark.parametrize(
    "host",
    ["evil.example", "127.0.0.1.evil.example", "", "localhost.evil.example:80", "[::2]", "evil.example#localhost"],
)
def test_a_name_that_is_not_its_own_is_refused(open_one: Served, host: str) -> None:
    assert open_one.ask("/", Host=host).status == 421


def test_its_own_names_are_answered(open_one: Served) -> None:
    for host in (f"127.0.0.1:{open_one.port}", f"localhost:{open_one.port}", f"LOCALHOST:{open_one.port}", "[::1]:80"):
        assert open_one.ask("/", Host=host).status == 200
    assert "cell.plant" in Gate.of(["Cell.Plant"], None).names


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "http://127.0.0.1:1", "http://127.0.0.1", "x"])
def test_what_another_site_asks_for_is_refused(open_one: Served, origin: str) -> None:
    assert open_one.ask("/events", Origin=origin).status == 403
    assert open_one.ask("/control/stop", "POST", "", Origin=origin).status == 403


def test_what_a_browser_says_of_another_site_is_believed(open_one: Served) -> None:
    assert open_one.ask("/report?run=a", Sec_Fetch_Site="cross-site").status == 403
    assert open_one.ask("/report?run=a", Sec_Fetch_Site="same-site").status == 403
    assert open_one.ask("/control/stop", "POST", "secret=x").status == 403, "no origin at all"


def test_a_form_without_the_secret_controls_nothing(open_one: Served) -> None:
    for body in ("", "secret=", "secret=wrong", "secret=" + "x" * 43):
        assert open_one.post("/control/zero", body).status == 403
    assert open_one.window.watcher.zero_mm == (0.0, 0.0)
    assert open_one.post("/control/zero", f"secret={open_one.window.gate.secret}").status == 200


def test_without_a_token_only_users_of_the_socket_control_anything(
    open_one: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    controls = open_one.window.controls
    assert controls is not None
    monkeypatch.setattr(type(controls), "is_allowed", lambda self, user: user != os.geteuid())
    refused = open_one.post("/control/zero", f"secret={open_one.window.gate.secret}")
    assert refused.status == 403 and "the socket does not allow this user to control rigd" in refused.text


def test_without_control_nothing_is_controlled(tmp_path: Path) -> None:
    with served(tmp_path) as one:
        assert one.window.gate.secret not in one.ask("/").text
        assert one.post("/control/zero", f"secret={one.window.gate.secret}").status == 403


def test_without_the_token_nothing_is_shown(closed: Served) -> None:
    for path in PAGES:
        assert closed.ask(path).status == 401, path
        page = closed.ask(path, Accept="text/html")
        assert (page.status, page.headers.get("location")) == (303, "/login"), path
    for given in ("Bearer wrong", f"Basic {TOKEN}", f"Bearer {TOKEN}x", "Bearer", f"Bearer  {TOKEN[:-1]}"):
        assert closed.ask("/runs", Authorization=given).status == 401, given
    for cookie in (f"{COOKIE}={TOKEN}", f"{COOKIE}=", f"{COOKIE}={'0' * 64}", "a=b; \x01", f"{COOKIE}"):
        assert closed.ask("/runs", Cookie=cookie).status == 401, cookie
    assert closed.post("/control/zero", f"secret={closed.window.gate.secret}").status == 401


def test_the_token_lets_in_and_is_in_no_address_and_no_cookie(closed: Served) -> None:
    assert closed.ask("/runs", Authorization=f"Bearer {TOKEN}").status == 200
    assert closed.ask(f"/runs?token={TOKEN}").status == 401
    wrong = closed.post("/login", "token=wrong")
    assert wrong.status == 403 and "set-cookie" not in wrong.headers
    right = closed.post("/login", f"token={TOKEN}")
    cookie = right.headers["set-cookie"]
    assert right.headers["location"] == "/" and TOKEN not in cookie
    assert "httponly" in cookie.lower() and "samesite=strict" in cookie.lower()
    assert closed.ask("/runs", Cookie=cookie.partition(";")[0]).status == 200
    assert closed.ask("/static/window.css").status == 200, "the page to sign in has its style"


def test_a_page_may_load_nothing_from_elsewhere_and_stand_in_no_frame(open_one: Served) -> None:
    for path in ("/", "/runs", "/nowhere", "/static/window.js"):
        headers = open_one.ask(path).headers
        policy = headers["content-security-policy"]
        assert "default-src 'none'" in policy and "unsafe" not in policy and "frame-ancestors 'none'" in policy
        assert headers["x-content-type-options"] == "nosniff" and "server" not in headers


def test_too_much_is_refused(open_one: Served) -> None:
    secret = open_one.window.gate.secret
    assert open_one.post("/control/start", "x" * 5000).status == 413
    many = "&".join(f"a{k}=1" for k in range(30)) + f"&secret={secret}"
    assert open_one.post("/control/zero", many).status == 400
    assert open_one.post("/control/zero", b"\xff\xfe=\xff&secret=x").status in (400, 403)
    chunked = b"".join(b"1000\r\n" + b"x" * 4096 + b"\r\n" for _ in range(4)) + b"0\r\n\r\n"
    head = b"POST /control/zero HTTP/1.1\r\nHost: 127.0.0.1\r\nOrigin: http://127.0.0.1\r\n"
    with open_one.raw(head + b"Transfer-Encoding: chunked\r\n\r\n" + chunked) as sock:
        assert sock.recv(100).startswith(b"HTTP/1.1 400")


@pytest.mark.parametrize("method", ["PUT", "DELETE", "OPTIONS", "TRACE", "PATCH"])
def test_only_get_and_post_are_answered(open_one: Served, method: str) -> None:
    assert open_one.ask("/", method).status == 405


def test_after_a_language_was_chosen_a_browser_goes_back_to_the_window_only(open_one: Served) -> None:
    for back in ("http://evil.example", "//evil.example", "/\\evil.example", "javascript:alert(1)"):
        assert open_one.post("/language", f"to=de&back={back}").headers["location"] == "/"
    answer = open_one.post("/language", "to=de&back=/runs?q=a")
    assert answer.headers["location"] == "/runs?q=a"
    assert "Läufe" in open_one.ask("/runs", Cookie=answer.headers["set-cookie"].partition(";")[0]).text
    assert "측정" in open_one.ask("/runs", Accept_Language="fr, ko-KR;q=0.8, de").text


def test_a_token_file_holds_a_token_that_nobody_else_reads(tmp_path: Path) -> None:
    file = tmp_path / "token"
    for text in ("short", "two words of some length", "x" * 2000, "töken-of-some-letters", ""):
        file.write_text(text)
        file.chmod(0o600)
        with pytest.raises(FileError):
            token_of(file)
    file.write_text(f"{TOKEN}\n")
    assert token_of(file) == TOKEN
    file.chmod(0o644)
    with pytest.raises(FileError, match="chmod 600"):
        token_of(file)
    with pytest.raises(FileError):
        token_of(tmp_path / "none")


def test_only_addresses_of_this_computer_need_no_token() -> None:
    assert is_loopback("127.0.0.1") and is_loopback("::1") and not is_loopback("192.168.1.5") and not is_loopback("::")
    with pytest.raises(UseError, match="not an IP address"):
        is_loopback("cell.plant")
