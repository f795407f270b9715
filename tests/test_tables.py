"""The tables of README and docs show the stored figures."""

import pytest

from benchmarks.readme_tables import TABLES, filled, pages


@pytest.mark.parametrize("page", pages(), ids=lambda page: page.name)
def test_tables_show_the_stored_figures(page):
    text = page.read_text()
    assert filled(text) == text, "run python -m benchmarks.readme_tables"


def test_every_table_is_shown_somewhere():
    text = "".join(page.read_text() for page in pages())
    assert [name for name in TABLES if f"<!-- table: {name} -->" not in text] == []
