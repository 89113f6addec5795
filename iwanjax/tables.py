"""Words and tables, as text for a terminal and as HTML for a notebook."""

import html
import re
from collections.abc import Iterable, Sequence
from typing import NamedTuple, TypeAlias

_NUMBER = re.compile(r"[+-]?(\d[\d.]*(e[+-]?\d+)?|nan|inf)( %)?|")
# Colours, fonts and backgrounds are the page's own, so that it reads on light and dark ones.
_CELL = "text-align:{side};padding:0.1em 1.5em 0.1em 0"
_HEAD = _CELL + ";border-bottom:1px solid currentColor"


class Grid(NamedTuple):
    """Rows of cells.

    Attributes
    ----------
    header : tuple of str
        Heads of the columns; empty for none.
    rows : tuple of tuple of str
        As many cells each.
    """

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    @property
    def lines(self) -> list[tuple[str, ...]]:
        """The header, where there is one, and the rows."""
        return [*([self.header] if self.header else []), *self.rows]

    @property
    def numeric(self) -> list[bool]:
        """Which columns hold numbers alone, and are aligned on the right."""
        return [
            all(map(_NUMBER.fullmatch, column)) and any(column)
            for column in zip(*self.rows, strict=True)
        ]


Block: TypeAlias = str | Grid
"""A paragraph, whose lines stay apart, or a table."""


def without_empty_columns(header: Sequence[str], rows: Iterable[Sequence[str]]) -> Grid:
    """A table of those columns that hold something."""
    rows = list(rows)
    kept = [i for i in range(len(header)) if any(row[i] for row in rows)]
    return Grid(
        tuple(header[i] for i in kept),
        tuple(tuple(row[i] for i in kept) for row in rows),
    )


def as_text(blocks: Iterable[Block]) -> str:
    """Blocks with an empty line between them; tables are aligned and set in by two spaces."""
    return "\n\n".join(
        block if isinstance(block, str) else "\n".join(_aligned(block))
        for block in blocks
        if block and (isinstance(block, str) or block.rows)
    )


def _aligned(grid: Grid) -> list[str]:
    widths = [max(map(len, column)) for column in zip(*grid.lines, strict=True)]
    sides = [str.rjust if right else str.ljust for right in grid.numeric]
    return [
        "  " + "  ".join(side(c, w) for side, c, w in zip(sides, row, widths, strict=True)).rstrip()
        for row in grid.lines
    ]


def as_html(blocks: Iterable[Block]) -> str:
    """The same for a notebook; what it says is escaped."""
    return "<div>" + "".join(map(_block, blocks)) + "</div>"


def _block(block: Block) -> str:
    if isinstance(block, str):
        return f"<p>{'<br>'.join(html.escape(line.strip()) for line in block.splitlines())}</p>"
    if not block.rows:
        return ""
    sides = ["right" if right else "left" for right in block.numeric]

    def row(cells: tuple[str, ...], tag: str, style: str) -> str:
        inside = (
            f'<{tag} style="{style.format(side=side)}">{html.escape(cell)}</{tag}>'
            for side, cell in zip(sides, cells, strict=True)
        )
        return f"<tr>{''.join(inside)}</tr>"

    head = f"<thead>{row(block.header, 'th', _HEAD)}</thead>" if block.header else ""
    body = "".join(row(cells, "td", _CELL) for cells in block.rows)
    return f'<table style="border-collapse:collapse">{head}<tbody>{body}</tbody></table>'
