"""Keyword lines of Abaqus files and the data lines below each.

Abaqus Analysis User's Guide, "Input syntax rules": ``*KEYWORD, OPTION=value, ...``; ``**`` starts
a comment.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class KeywordBlock:
    """A keyword and what stands below it.

    Attributes
    ----------
    keyword : str
        In capitals without its star; empty for what stands above the first keyword.
    options : mapping of str to str
        In capitals, with their values; empty text for those without one.
    lines : list of str
        Data lines; comments are blank, so that lines can be counted.
    comments : list of (int, str)
        Comments with their line numbers, without their stars.
    start : int
        Number of the first data line.
    """

    keyword: str
    options: Mapping[str, str]
    lines: list[str]
    comments: list[tuple[int, str]]
    start: int


def sections(lines: Sequence[str]) -> list[KeywordBlock]:
    """A file cut at its keyword lines."""
    found = [KeywordBlock("", {}, [], [], 1)]
    for number, line in enumerate(lines, 1):
        text = line.strip()
        if text.startswith("**"):
            found[-1].comments.append((number, text.lstrip("*").strip()))
            found[-1].lines.append("")
        elif text.startswith("*"):
            keyword, *options = (part.strip() for part in text[1:].split(","))
            values = (option.partition("=") for option in options)
            settings = {name.strip().upper(): value.strip() for name, _, value in values}
            found.append(KeywordBlock(keyword.upper(), settings, [], [], number + 1))
        else:
            found[-1].lines.append(text)
    return found
