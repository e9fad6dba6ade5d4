"""Results of runs: folders, comparison, pictures, provenance."""
