import pytest

from tests.support.drawn_tables import drawn_tables, judged
from tests.support.nightly import cases

TABLES = drawn_tables()
# Two files without a header, of which one has decimal commas; a tracker that was moved before the last six of 25 rows;
# a sound arm within 0.1 mm of its nominal constants.
EACH_COMMIT = ["old-155", "old-520", "old-538"]


@pytest.mark.cpu_limit(120)
@pytest.mark.parametrize("name", cases(TABLES, EACH_COMMIT))
def test_drawn_table_is_read_correctly_or_questioned(name, tmp_path):
    table = TABLES[name]
    done = judged(table, tmp_path)
    assert not done.wrong, done.lines
    assert done.outcome != "wrong guess", done.lines
    if table.sound:
        assert done.outcome != "refused", done.lines
