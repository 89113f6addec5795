"""One self-contained HTML page of words, figures and tables."""

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from typing import Literal

from matplotlib.figure import Figure

from iwanjax.errors import InputError

_DPI = 200
# Pixels of the page per pixel of a figure: a fifth larger than on paper.
_SHRINK = 1.2 * 96 / _DPI
# Frame about a figure, pixels of the page.
_FRAME = 18
_PNG = b"\x89PNG\r\n\x1a\n"

_STYLE = """
:root {
  color-scheme: light dark;
  --ink: #1b1f24; --soft: #57606a; --paper: #ffffff; --line: #d0d7de;
  --note: #fff8e1; --note-line: #b36b00;
  --warn: #fdecea; --warn-line: #b3261e;
}
@media screen and (prefers-color-scheme: dark) {
  :root {
    --ink: #e6e8eb; --soft: #9aa4af; --paper: #16191d; --line: #3a424b;
    --note: #33290f; --note-line: #e0a030;
    --warn: #3a1b19; --warn-line: #f0837a;
  }
}
* { box-sizing: border-box; }
body {
  margin: 0 auto; padding: 2rem 1.25rem 3rem; max-width: 60rem;
  background: var(--paper); color: var(--ink);
  font: 1rem/1.55 system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", sans-serif;
}
h1 { font-size: 1.7rem; line-height: 1.25; margin: 0 0 1rem; }
h2 {
  font-size: 1.3rem; margin: 2.5rem 0 0.75rem; padding-top: 0.75rem;
  border-top: 1px solid var(--line);
}
p { margin: 0.6rem 0; max-width: 46rem; }
.lead p { font-size: 1.08rem; }
.callout {
  margin: 1rem 0; padding: 0.6rem 0.9rem; max-width: 46rem;
  border-left: 0.3rem solid; border-radius: 0.2rem;
}
.callout strong { text-transform: uppercase; letter-spacing: 0.03em; margin-right: 0.4em; }
.bound { background: var(--note); border-color: var(--note-line); }
.warning { background: var(--warn); border-color: var(--warn-line); }
.figures { display: flex; flex-wrap: wrap; gap: 1.25rem; align-items: flex-start; }
figure { margin: 1rem 0; flex: 0 1 auto; max-width: 100%; }
figure img {
  display: block; width: 100%; height: auto; background: #ffffff;
  padding: 0.5rem; border: 1px solid var(--line); border-radius: 0.3rem;
}
figcaption, caption { color: var(--soft); font-size: 0.9rem; text-align: left; }
figcaption { margin-top: 0.4rem; max-width: 46rem; }
caption { padding-bottom: 0.4rem; }
.table { overflow-x: auto; margin: 1rem 0; }
table { border-collapse: collapse; font-size: 0.92rem; }
th, td { padding: 0.3rem 0.7rem; border-bottom: 1px solid var(--line); vertical-align: baseline; }
th { font-weight: 600; border-bottom-width: 2px; }
th, td { text-align: left; }
.number { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
footer {
  margin-top: 3rem; padding-top: 0.75rem; border-top: 1px solid var(--line);
  color: var(--soft); font-size: 0.85rem;
}
@media print {
  :root { color-scheme: light; }
  body { max-width: none; padding: 0; font-size: 10pt; }
  figure, tr, .callout { break-inside: avoid; }
  h2 { break-after: avoid; }
}
"""


@dataclass(frozen=True)
class Callout:
    """A paragraph that must not be overlooked.

    Parameters
    ----------
    text : str
        What to know.
    kind : {"warning", "bound"}
        Something is wrong, or the result rests on a bound.
    """

    text: str
    kind: Literal["warning", "bound"] = "warning"


@dataclass(frozen=True)
class NamedParagraph:
    """A paragraph that begins with what it is about.

    Parameters
    ----------
    name : str
        Printed bold.
    text : str
        What there is to say.
    """

    name: str
    text: str


@dataclass(frozen=True)
class PageTable:
    """Rows of words and numbers.

    Parameters
    ----------
    header : tuple of str
        Heads of the columns.
    rows : tuple of tuple of str
        As many cells each.
    caption : str
        What they are.
    words : tuple of int
        Columns that hold words; the others hold numbers, which are aligned on the right.

    Raises
    ------
    InputError
        For a row of another length than the header.
    """

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    caption: str = ""
    words: tuple[int, ...] = (0,)

    def __post_init__(self) -> None:
        """Hold the rows against the header."""
        for i, row in enumerate(self.rows):
            if len(row) != len(self.header):
                raise InputError(
                    f"table {self.caption!r}: row {i} has {len(row)} cells; expected "
                    f"{len(self.header)} like the header"
                )


@dataclass(frozen=True, eq=False)
class PageSection:
    """A part of a page: words, then figures, then tables.

    Parameters
    ----------
    title : str
        Its heading.
    paragraphs : tuple of str, Callout or NamedParagraph
        Plain text.
    figures : tuple of (str, Figure or bytes)
        Caption, which is the alternative text too, and the figure or a PNG file's contents.
    tables : tuple of PageTable
        What there is in numbers.
    """

    title: str
    paragraphs: tuple[str | Callout | NamedParagraph, ...] = ()
    figures: tuple[tuple[str, Figure | bytes], ...] = ()
    tables: tuple[PageTable, ...] = ()


def render(
    title: str,
    lead_sentences: Sequence[str | Callout | NamedParagraph],
    sections: Sequence[PageSection],
    footer: str = "",
) -> str:
    """A page as one HTML file that needs nothing else: no scripts, no links, images inside.

    Parameters
    ----------
    title : str
        Heading of the page.
    lead_sentences : sequence of str, Callout or NamedParagraph
        The result in words, a paragraph each.
    sections : sequence of PageSection
        What it rests on.
    footer : str
        Last line.

    Returns
    -------
    str
        HTML; all text that was given is escaped.

    Raises
    ------
    InputError
        For bytes that are not a PNG file.
    """
    parts = [
        "<!DOCTYPE html>",
        '<html lang="en">',
        "<head>",
        '<meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<title>{escape(title)}</title>",
        f"<style>{_STYLE}</style>",
        "</head>",
        "<body>",
        f"<h1>{escape(title)}</h1>",
        '<div class="lead">',
        *map(_paragraph, lead_sentences),
        "</div>",
        *map(_section, sections),
    ]
    if footer:
        parts.append(f"<footer>{escape(footer)}</footer>")
    return "\n".join([*parts, "</body>", "</html>", ""])


def png(figure: Figure) -> bytes:
    """A figure as the contents of a PNG file."""
    buffer = io.BytesIO()
    figure.set_dpi(_DPI)
    engine = figure.get_layout_engine()
    if engine is not None:
        # Once, by itself: savefig would draw all of the figure for it, unseen.
        engine.execute(figure)
        figure.set_layout_engine("none")
    figure.savefig(buffer, format="png", dpi=_DPI)
    return buffer.getvalue()


def _section(section: PageSection) -> str:
    parts = ["<section>", f"<h2>{escape(section.title)}</h2>"]
    parts += map(_paragraph, section.paragraphs)
    if section.figures:
        figures = (_figure(caption, figure) for caption, figure in section.figures)
        parts += ['<div class="figures">', *figures, "</div>"]
    parts += map(_table, section.tables)
    return "\n".join([*parts, "</section>"])


def _paragraph(text: str | Callout | NamedParagraph) -> str:
    if isinstance(text, Callout):
        return (
            f'<p class="callout {text.kind}" role="note"><strong>{text.kind}</strong>'
            f"{escape(text.text)}</p>"
        )
    if isinstance(text, NamedParagraph):
        return f"<p><strong>{escape(text.name)}.</strong> {escape(text.text)}</p>"
    return f"<p>{escape(text)}</p>"


def _figure(caption: str, figure: Figure | bytes) -> str:
    contents = figure if isinstance(figure, bytes) else png(figure)
    if not contents.startswith(_PNG):
        raise InputError(f"figure {caption!r}: is neither a Figure nor a PNG file's contents")
    # Width and height are the first two numbers of its first chunk.
    width, height = (int.from_bytes(contents[i : i + 4]) for i in (16, 20))
    shown = round(width * _SHRINK) + _FRAME
    source = f"data:image/png;base64,{base64.b64encode(contents).decode('ascii')}"
    words = escape(caption)
    return (
        f'<figure style="width: {shown}px">'
        f'<img src="{source}" alt="{words}" width="{width}" height="{height}">'
        f"<figcaption>{words}</figcaption></figure>"
    )


def _table(table: PageTable) -> str:
    def row(cells: Sequence[str], tag: str) -> str:
        kinds = ["" if i in table.words else ' class="number"' for i in range(len(cells))]
        inside = (f"<{tag}{k}>{escape(c)}</{tag}>" for c, k in zip(cells, kinds, strict=True))
        return f"<tr>{''.join(inside)}</tr>"

    caption = f"<caption>{escape(table.caption)}</caption>" if table.caption else ""
    body = "\n".join(row(cells, "td") for cells in table.rows)
    return (
        f'<div class="table"><table>{caption}\n<thead>{row(table.header, "th")}</thead>\n'
        f"<tbody>\n{body}\n</tbody></table></div>"
    )
