"""The page of solids shows the table that is kept, and no other."""

from kept import ROOT, read
from third_dimension import TABLE, in_words


def test_the_page_s_table_is_the_kept_one() -> None:
    page = (ROOT / "docs" / "explanation" / "solid.md").read_text(encoding="utf-8")
    rows = read(TABLE)
    assert in_words(rows) in page
    assert f"{len(rows)} of its 48 cells" in page
