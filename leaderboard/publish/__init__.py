"""Every table and picture of README, docs and leaderboard, written from what the repository keeps.

Nothing here simulates: result rows, transfer episodes, blind scores and measurements go in, files
come out. `python -m leaderboard.publish` writes them, `--check` says which are stale. It makes
every file again and compares bytes, which are equal wherever the pinned packages are. Pictures that
only an engine can draw are held against digests instead, see `figures`.
"""
