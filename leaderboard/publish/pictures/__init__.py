"""Pictures that are made from results; importing them enters them into the registry."""

from leaderboard.publish.pictures import copies, curves, history, speed

__all__ = ["copies", "curves", "history", "speed"]
