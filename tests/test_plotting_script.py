import gzip

from scripts.tools.plotting_script import TEMPLATES, made


def test_the_script_and_its_licence_are_those_that_the_command_makes():
    files = made()
    script = gzip.decompress((TEMPLATES / "plotly.min.js.gz").read_bytes())
    assert script == gzip.decompress(files["plotly.min.js.gz"])
    assert (TEMPLATES / "plotly.txt").read_bytes() == files["plotly.txt"]
    assert b"plotly.js v" in script[:300]
    assert "MIT" in files["plotly.txt"].decode()
