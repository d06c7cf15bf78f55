"""GRBL and grblHAL boards: `stage` moves, `line` talks, `words` reads what the board says."""
