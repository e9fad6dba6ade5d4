"""A seeded fuzzer: odd files, damaged folders and odd arguments, and what comes of them."""
