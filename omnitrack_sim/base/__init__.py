"""Text, faults, files and folders, names, vectors: what every room stands on and no robot needs."""
