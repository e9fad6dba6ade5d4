"""The window: a scenario as it runs, a saved run again, a robot driven by keyboard."""
