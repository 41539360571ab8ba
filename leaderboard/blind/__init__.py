"""The blind sets: one line each in history.csv, the latest of each kind in full in scores/."""
