"""Blocks by page; importing them enters them into the registry."""

from leaderboard.publish.blocks import (
    blind,
    learning,
    paper,
    physics,
    settings,
    speed,
    transfer,
)

__all__ = ["blind", "learning", "paper", "physics", "settings", "speed", "transfer"]
