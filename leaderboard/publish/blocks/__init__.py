"""Blocks by page; importing them enters them into the registry."""

from leaderboard.publish.blocks import (
    blind,
    contacts,
    learning,
    paper,
    physics,
    speed,
    transfer,
)

__all__ = ["blind", "contacts", "learning", "paper", "physics", "speed", "transfer"]
