"""The encoding of an XML file, as its first bytes and its declaration state it."""

from __future__ import annotations

import codecs
import re

_MARKS = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
    (b"<\0", "utf-16-le"),
    (b"\0<", "utf-16-be"),
)
_DECLARED = re.compile(rb"""\s*<\?xml[^>]{0,200}?\sencoding\s*=\s*["']([A-Za-z][\w.:-]*)["']""")
DECLARE = 'declare its encoding in the first line, as <?xml version="1.0" encoding="ISO-8859-1"?>'


def xml_encoding(data: bytes) -> str:
    """Return the name of the encoding of an XML file: UTF-8 if it states none.

    A declaration that cannot be true, such as UTF-16 in a file of single bytes, counts as none.

    Raises:
        LookupError: If it declares an encoding that is not known.
    """
    for mark, name in _MARKS:
        if data.startswith(mark):
            return name
    declared = _DECLARED.match(data[:400])
    if declared is None:
        return "utf-8"
    name = declared[1].decode("ascii")
    try:
        plausible = declared[0].decode(name, "replace") == declared[0].decode("ascii", "replace")
    except UnicodeError:
        plausible = False
    return name if plausible else "utf-8"
