"""True bores of nominal ones: sizes of steel pipe after ASME B36.10M."""


def true_bore(nominal: float, schedule: str) -> float:
    return nominal
