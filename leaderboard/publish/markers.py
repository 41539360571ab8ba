"""Blocks between markers in a Markdown page.

<!-- results: NAME -->

what the block of that name gives

<!-- /results -->
"""

import re
from collections.abc import Callable

OPEN = "<!-- results:"
_PART = re.compile(r"<!-- results: ([a-z0-9-]+) -->\n.*?<!-- /results -->", re.DOTALL)


class MarkerError(ValueError):
    """A page's markers are wrong; the message is complete but for the page."""


def fill(text: str, give: Callable[[str], str]) -> str:
    """The page with what `give` says of each name between its markers; raises MarkerError."""
    names = _PART.findall(text)
    if len(names) != text.count(OPEN) or len(names) != text.count("<!-- /results -->"):
        raise MarkerError(
            f"{text.count(OPEN)} markers open a block and {len(names)} blocks are whole; allowed: "
            "<!-- results: NAME --> and <!-- /results -->, each on a line of its own"
        )
    return _PART.sub(lambda found: _whole(found[1], give(found[1])), text)


def bare(text: str) -> str:
    """The page without its blocks: what is written by hand."""
    return _PART.sub("", text)


def _whole(name: str, content: str) -> str:
    """A block with its markers; blank lines, or a table behind a comment is no table."""
    return f"{OPEN} {name} -->\n\n{content}\n\n<!-- /results -->"
