"""Networks from the files of other programs: drawings of towns, isometrics of plants."""
