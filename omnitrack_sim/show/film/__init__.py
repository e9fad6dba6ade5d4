"""Films and pictures of saved runs."""
