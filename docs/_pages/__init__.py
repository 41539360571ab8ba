"""Pages that are made from the program when the docs are built; none of them is committed.

Each module has `pages()`: Markdown texts by their path under `docs/`. What is written by hand in
them stands in `docs/_texts`.
"""

from pathlib import Path

from _pages import commands, effects, faults, parts, python, results

LIMIT_BYTES = 12_000
"""No page is longer."""


def write(docs: Path) -> None:
    """Write all made pages, leaving alone what has not changed, and remove those of before.

    Beside the pages of a folder under `reference` nothing else may lie.
    """
    made = [one.pages() for one in (commands, effects, faults, parts, python, results)]
    texts = {path: text for pages in made for path, text in pages.items()}
    for path, text in texts.items():
        if len(text.encode()) > LIMIT_BYTES:
            raise ValueError(f"{path} has {len(text.encode())} bytes, {LIMIT_BYTES} are allowed")
        _write(docs / path, text)
    for folder in {(docs / path).parent for path in texts} - {docs / "reference"}:
        for old in folder.glob("*.md"):
            if old.relative_to(docs).as_posix() not in texts:
                old.unlink()


def _write(path: Path, text: str) -> None:
    if path.exists() and path.read_text() == text:
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
