"""Random approaches to fittings, and how often a recogniser is right about them."""
