"""Blocks between markers in a Markdown page.

<!-- results: NAME -->

what the block of that name gives

<!-- /results -->
"""

import re
from collections.abc import Callable

_PART = re.compile(
    r"^<!-- results: ([a-z0-9-]+) -->\n.*?^<!-- /results -->$", re.DOTALL | re.MULTILINE
)
_OPEN, _CLOSE = (re.compile(mark, re.MULTILINE) for mark in ("^<!-- results:", "^<!-- /results"))


class MarkerError(ValueError):
    """A page's markers are wrong; the message is complete but for the page."""


def fill(text: str, give: Callable[[str], str]) -> str:
    """The page with what `give` says of each name between its markers; raises MarkerError."""
    whole, opened, closed = (len(mark.findall(text)) for mark in (_PART, _OPEN, _CLOSE))
    if not whole == opened == closed:
        raise MarkerError(
            f"{opened} markers open a block, {closed} close one, {whole} blocks are whole; "
            "allowed: <!-- results: NAME --> and <!-- /results -->, each on a line of its own"
        )
    return _PART.sub(lambda found: _whole(found[1], give(found[1])), text)


def has_blocks(text: str) -> bool:
    """Whether a page holds a block, whole or not."""
    return _OPEN.search(text) is not None or _CLOSE.search(text) is not None


def bare(text: str) -> str:
    """The page without its blocks: what is written by hand."""
    return _PART.sub("", text)


def _whole(name: str, content: str) -> str:
    """A block with its markers; blank lines, or a table behind a comment is no table."""
    return f"<!-- results: {name} -->\n\n{content}\n\n<!-- /results -->"
