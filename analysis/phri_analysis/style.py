"""How controllers look and numbers read, in every picture and table alike."""

import math

# Okabe-Ito palette: told apart with any colour vision; the marker says the same once more for print in grey.
_KNOWN = {
    "none": ("(a) none", "#6b6b6b", "o"),
    "lqr": ("(b) LQR", "#0072b2", "s"),
    "mahalanobis": ("(c) Mahalanobis", "#d55e00", "^"),
    "pd": ("PD", "#009e73", "D"),
}
_SPARE = (("#cc79a7", "v"), ("#e69f00", "P"), ("#56b4e9", "X"), ("#000000", "*"))
ORDER = tuple(_KNOWN)


def controller_order(name: str):
    """Sort key: the thesis' order first, other controllers by name after them."""
    return (f"{ORDER.index(name):02d}" if name in ORDER else "99") + name


def label(name: str) -> str:
    return _KNOWN[name][0] if name in _KNOWN else name


def _spare(name):
    # Not hash(): it changes from process to process.
    return _SPARE[sum(name.encode()) % len(_SPARE)]


def colour(name: str) -> str:
    return _KNOWN[name][1] if name in _KNOWN else _spare(name)[0]


def marker(name: str) -> str:
    return _KNOWN[name][2] if name in _KNOWN else _spare(name)[1]


def number(value: float, unit: str = "") -> str:
    """A value for a table: three significant digits, shares in per cent, lengths below 1 m in mm, a dash for NaN."""
    if value is None or math.isnan(value):
        return "–"
    return f"{value:g}" if unit == "count" else _digits(value * scale(unit))


def scale(unit: str) -> float:
    """Factor from the measure's unit to the one that tables and axes show, see `shown_unit`."""
    return {"m": 1e3, "share": 1e2}.get(unit, 1.0)


def shown_unit(unit: str) -> str:
    return {"m": "mm", "share": "%"}.get(unit, unit)


def _digits(value):
    if value == 0:
        return "0"
    decimals = max(0, 2 - math.floor(math.log10(abs(value)))) if abs(value) >= 1e-3 else None
    return f"{value:.{decimals}f}" if decimals is not None else f"{value:.1e}"


def row_of_means(means, deviations, unit: str = "") -> list:
    """`12.9 ± 1.4` for each controller, all with the decimals that give the largest mean three digits, so that they
    compare at a glance; a dash for NaN, no ± where there is no deviation."""
    factor = scale(unit)
    largest = max((abs(value) * factor for value in means if not math.isnan(value)), default=0.0)
    decimals = min(4, max(0, 2 - math.floor(math.log10(largest)))) if largest > 0 else 0

    def show(mean, deviation):
        if math.isnan(mean):
            return "–"
        if mean == 0 and not deviation > 0:
            return "0"
        spread = "" if math.isnan(deviation) else f" ± {deviation * factor:.{decimals}f}"
        return f"{mean * factor:.{decimals}f}{spread}"

    return [show(mean, deviation) for mean, deviation in zip(means, deviations)]
