"""The smallest run that trains."""

SMOKE = ["run", "--task", "circle", "--smoke", "--json", "--workers", "1"]
"""Words of it, but for engine and folder."""
