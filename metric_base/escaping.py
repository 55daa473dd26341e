"""Text from files and pages, made fit for a terminal: it cannot move the cursor, nor hide or reverse other text."""

from __future__ import annotations

import re

#: Control characters, the marks that turn text round or hide it (Unicode's bidirectional and format controls, tags),
#: line and paragraph separators, and halves of surrogate pairs.
_HIDDEN = (
    "\x00-\x1f\x7f-\x9f\u00ad\u061c\u180e\u200b\u200e\u200f\u2028-\u202e\u2060-\u206f\ufeff\ufff9-\ufffb"
    "\ud800-\udfff\U000e0000-\U000e007f"
)
_CONTROL = re.compile(f"[{_HIDDEN}]")


def visible(text: str) -> str:
    r"""The text with every control and invisible character written out.

    >>> visible("chair\x1b[2J")
    'chair\\x1b[2J'
    """
    return _CONTROL.sub(lambda match: match[0].encode("unicode_escape", "surrogatepass").decode("ascii"), text)


def visible_json(text: str) -> str:
    r"""JSON text that means the same, with invisible characters as JSON's own escapes.

    >>> visible_json('"a\u202eb"')
    '"a\\u202eb"'
    """
    return _CONTROL.sub(_json_escape, text)


def _json_escape(match: re.Match[str]) -> str:
    if match[0] == "\n":  # between fields it is JSON's own
        return "\n"
    units = match[0].encode("utf-16-be", "surrogatepass")
    return "".join(f"\\u{units[place : place + 2].hex()}" for place in range(0, len(units), 2))
