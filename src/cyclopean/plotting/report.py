"""A one-page report that needs no other file: numbers, settings and pictures."""

from __future__ import annotations

import base64
import html
import io
from collections.abc import Mapping, Sequence
from pathlib import Path

from matplotlib.figure import Figure

from ..errors import OutputError

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #222; max-width: 1100px; margin: 2em auto; padding: 0 1em; }
h1 { font-size: 1.6em; margin-bottom: 0; } h2 { font-size: 1.15em; margin: 1.6em 0 .4em; }
table { border-collapse: collapse; margin: .3em 0; } th, td { padding: .2em .9em .2em 0; text-align: left;
border-bottom: 1px solid #ddd; } td.number { text-align: right; font-variant-numeric: tabular-nums; }
figure { margin: 1em 0; } img { max-width: 100%; } figcaption, .small { color: #666; font-size: .9em; }
.warning { background: #fff3cd; padding: .4em .8em; border-left: 4px solid #e0a800; }
"""


def write_report(
    path: Path,
    title: str,
    subtitle: str,
    tables: Mapping[str, tuple[Sequence[str], Sequence[Sequence[object]]]],
    pictures: Mapping[str, Figure],
    warnings: Sequence[str] = (),
    captions: Mapping[str, str] | None = None,
) -> None:
    """Write a self-contained HTML page.

    Parameters
    ----------
    path : Path
        File to write.
    title, subtitle : str
        Heading, and the line below it.
    tables : mapping
        Heading -> (column names, rows); numbers in the rows are set flush right.
    pictures : mapping
        Caption -> figure, embedded as PNG.
    warnings : sequence of str
        What the reader must know first.
    captions : mapping, optional
        Heading of a table -> what to know about it, set below it.
    """
    parts = [f"<h1>{html.escape(title)}</h1><p class='small'>{html.escape(subtitle)}</p>"]
    parts += [f"<p class='warning'>{html.escape(text)}</p>" for text in warnings]
    pictures_left = [_figure_html(caption, figure) for caption, figure in pictures.items()]
    parts += pictures_left[:1]
    parts += [_table_html(heading, *table, (captions or {}).get(heading, "")) for heading, table in tables.items()]
    parts += pictures_left[1:]
    page = (
        f"<!doctype html><html lang='en'><head><meta charset='utf-8'><title>{html.escape(title)}</title>"
        f"<style>{_STYLE}</style></head><body>{''.join(parts)}</body></html>\n"
    )
    try:
        path.write_text(page, encoding="utf-8")
    except OSError as error:
        raise OutputError(f"cannot write the report {path}: {error.strerror or error}") from error


def _figure_html(caption, figure):
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png")
    data = base64.b64encode(buffer.getvalue()).decode("ascii")
    text = html.escape(caption)
    return f"<figure><img alt='{text}' src='data:image/png;base64,{data}'><figcaption>{text}</figcaption></figure>"


def _table_html(heading, columns, rows, caption):
    def cell(value):
        number = isinstance(value, (int, float)) or (isinstance(value, str) and value.lstrip("+-")[:1].isdigit())
        return f"<td{' class=number' if number else ''}>{html.escape(str(value))}</td>"

    head = "".join(f"<th>{html.escape(column)}</th>" for column in columns)
    body = "".join(f"<tr>{''.join(cell(value) for value in row)}</tr>" for row in rows)
    below = f"<p class='small'>{html.escape(caption)}</p>" if caption else ""
    return f"<h2>{html.escape(heading)}</h2><table><tr>{head}</tr>{body}</table>{below}"
