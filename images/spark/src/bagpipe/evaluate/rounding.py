"""With how many digits figures are kept that are drawn: few, and what differs stays different."""

import math
from collections.abc import Collection

# A float has not many more that mean anything.
_MOST_DIGITS = 15


def digits_for(values: Collection[float], least: int) -> int:
    """`least` digits of the range of finite values, also where they lie far from zero.

    Coordinates of a map are of millions of metres, of which a drive changes the last ones.
    """
    if not values:
        return least
    span, size = max(values) - min(values), max(map(abs, values))
    if not 0 < span < math.inf:
        return least
    far = math.log10(min(size / span, 10.0**_MOST_DIGITS))
    return min(_MOST_DIGITS, least + max(0, math.floor(far)))


def rounded(value: float, digits: int) -> float:
    """The value with so many digits."""
    return float(f"{value:.{digits}g}")


def rounded_within(value: float, digits: int, low: float | None, high: float | None) -> float:
    """The same, but for a value that would come to lie on another side of a bound."""
    kept = rounded(value, digits)
    return kept if _sides(kept, low, high) == _sides(value, low, high) else value


def _sides(value: float, low: float | None, high: float | None) -> tuple[bool, bool]:
    return low is not None and value < low, high is not None and value > high
