"""Commands that are killed at any moment, and what is there afterwards."""
