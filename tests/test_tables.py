"""The tables of README and docs show the stored figures."""

import pytest

from benchmarks import dense_tables
from benchmarks.readme_tables import TABLES, filled, pages


@pytest.mark.parametrize("page", pages(), ids=lambda page: page.name)
def test_tables_show_the_stored_figures(page):
    text = page.read_text()
    assert filled(text) == text, "run python -m benchmarks.readme_tables"


def test_every_table_is_shown_somewhere():
    text = "".join(page.read_text() for page in pages())
    assert [name for name in TABLES if f"<!-- table: {name} -->" not in text] == []


@pytest.mark.parametrize("table", [dense_tables.short, dense_tables.accuracy, dense_tables.seconds])
def test_a_table_of_dense_depth_has_one_row_for_each_scene(table):
    row = {"hypotheses": 65.0, "match_seconds": 0.2, "complete_percent": 98.0, "grey1x_match_seconds": 0.15}
    figures = {f"{scene}_{key}": value for scene in ("one", "other") for key, value in row.items()}
    lines = table(figures).splitlines()
    assert [line.split(" | ")[0] for line in lines[2:]] == ["| one", "| other"]
    assert len(table({}).splitlines()) == 2  # nothing measured: the heads alone
