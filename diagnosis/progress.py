"""What a long computation tells of its progress."""

from collections.abc import Callable

Progress = Callable[[str, float], None]
"""Is called with what is being done, and the share of all that is done; it may raise `Stop`."""


class Stop(Exception):
    """No more is to be computed; what is known so far is the answer, where there is one."""


def within(progress: Progress, begin: float, end: float) -> Progress:
    """The progress of a part, as one of the whole: it is `begin` to `end` of that."""
    return lambda text, share: progress(text, begin + (end - begin) * share)


def forward(progress: Progress) -> Progress:
    """The progress without steps back: a search that begins again takes some."""
    done = 0.0

    def tell(text: str, share: float) -> None:
        nonlocal done
        done = max(done, share)
        progress(text, done)

    return tell
