"""What a run leaves: the result, its folder, what is compared, its provenance."""
