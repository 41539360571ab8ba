"""The named blocks of text and the pictures that pages can hold."""

from collections.abc import Callable

from leaderboard.publish.kept import Kept

Block = Callable[[Kept], str]
"""Markdown from what is kept, without an end of line."""
Picture = Callable[[Kept], bytes]
"""A file from what is kept, equal bytes from equal results."""
BLOCKS: dict[str, Block] = {}
"""By the name that stands in a page's marker."""
PICTURES: dict[str, Picture] = {}
"""By the path of the file, from the repository's root."""


def block(function: Block) -> Block:
    """Enter a block under its function's name, with hyphens."""
    BLOCKS[function.__name__.replace("_", "-")] = function
    return function


def picture(path: str) -> Callable[[Picture], Picture]:
    """Enter a picture under its path."""

    def enter(function: Picture) -> Picture:
        PICTURES[path] = function
        return function

    return enter
