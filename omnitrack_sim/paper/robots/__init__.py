"""Claims of robots, one module each: tuples `MEASURES` that their classes name."""
