import pickle
from pathlib import Path

import pytest

from analysis.runs.remote import RemotePath, location
from tests.support.refusals import refused


@pytest.mark.parametrize(
    ("given", "text", "top", "steps"),
    [
        ("s3://bucket/plant/run", "s3://bucket/plant/run", "s3://bucket", ("plant", "run")),
        ("S3://bucket/", "s3://bucket", "s3://bucket", ()),
        ("sftp://me@10.0.0.5:22/srv", "sftp://me@10.0.0.5:22/srv", "sftp://me@10.0.0.5:22", ("srv",)),
        ("sftp://10.0.0.5:22/srv/a@b", "sftp://10.0.0.5:22/srv/a@b", "sftp://10.0.0.5:22", ("srv", "a@b")),
        ("file:///srv//plant/", "file:///srv/plant", "file:///", ("srv", "plant")),
        ("s3://bucket/a?b#c d%20", "s3://bucket/a?b#c d%20", "s3://bucket", ("a?b#c d%20",)),
    ],
)
def test_the_text_is_the_url(given, text, top, steps):
    found = location(given)
    assert (str(found), found.top, found.steps) == (text, top, steps)
    assert str(found / "run") == f"{text}/run" and (found / "run").name == "run"
    assert (found / "run").parent == found and (found / "run").resolve() == (found / "run").absolute() == found / "run"
    again = pickle.loads(pickle.dumps(found))  # noqa: S301 - our own
    assert isinstance(again, RemotePath) and str(again) == text


@pytest.mark.parametrize("text", ["runs", "/srv/runs", "s3:/bucket", "C:/runs", "a b", ""])
def test_all_else_is_a_path(text):
    assert type(location(text)) is type(Path())
    assert location(text) == Path(text)


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("sftp://me:hidden@host/srv", "url.password"),
        ("ftp://:hidden@host", "url.password"),
        ("https://host/runs?X-Amz-Signature=hidden", "url.query"),
        ("sftp://me:hid/hidden@host/srv", "url.password"),
        ("sftp://me:/hidden@host/srv", "url.password"),
        ("zip://runs::s3://hidden/x.zip", "url.form"),
        ("simplecache::s3://me:hidden@runs/x", "url.form"),
        ("sftp://[::1]/srv", "url.form"),
        ("s3://", "url.form"),
        ("sftp:///srv", "url.form"),
        ("file://host/srv", "url.form"),
    ],
)
def test_invalid_url_is_one_line_without_secrets(text, code):
    with refused(code) as error:
        location(text)
    assert "hidden" not in str(error.value)
