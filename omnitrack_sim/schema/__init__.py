"""What users write in files: tables with their keys, units and limits; reading; dotted paths."""
