"""Every table and picture of README, docs and leaderboard, written from what the repository keeps.

Nothing here simulates: result rows, transfer episodes, blind scores and measurements go in, files
come out. `python -m leaderboard.publish` writes them, `--check` says which are stale.
"""
