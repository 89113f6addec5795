"""Text of a file, in whatever way it is encoded."""

import codecs
from pathlib import Path

from iwanjax.errors import InputError

_MARKS = {
    codecs.BOM_UTF8: "utf-8-sig",
    codecs.BOM_UTF16_LE: "utf-16",
    codecs.BOM_UTF16_BE: "utf-16",
}


def decoded(path: Path) -> str:
    """A text file by its byte order mark, else UTF-8, else Windows' Western European code page.

    The last is what acquisition programs write a "²" or a "µ" in.

    Raises
    ------
    InputError
        For what is no text, not naming the file.
    """
    content = path.read_bytes()
    marked = next((code for mark, code in _MARKS.items() if content.startswith(mark)), None)
    for encoding in (marked,) if marked else ("utf-8", "cp1252"):
        try:
            text = content.decode(encoding)
        except UnicodeDecodeError:
            continue
        if not any(c < " " and c not in "\t\r\n" for c in set(text)):
            return text
    raise InputError("is no text in UTF-8, UTF-16 or Windows-1252; export it again as text")
