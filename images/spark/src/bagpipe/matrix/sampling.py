"""Which combinations of many are run: by shares of their values, or by covering every pair.

Pure and deterministic; both give positions in the list of allowed combinations, ascending.
"""

import itertools
import random
from collections import Counter, defaultdict
from collections.abc import Hashable, Mapping, Sequence

from allpairspy import AllPairs

Row = Mapping[str, object]

# How many candidates one pick of a sample looks at: enough for even shares, and linear in time.
_CANDIDATES = 256


def stratified(
    rows: Sequence[Mapping[str, tuple[Hashable, float]]], limit: int, seed: int
) -> list[int]:
    """`limit` rows in which each value's share is as near to its weight's share as can be.

    A row maps each variable to its value and that value's weight. Each pick takes, of some
    candidates in random order, the one whose values are furthest below their share so far.
    """
    shares = _shares(rows)
    left = list(range(len(rows)))
    random.Random(seed).shuffle(left)  # noqa: S311  a sample, and no secret
    taken: Counter[tuple[str, Hashable]] = Counter()
    picked: list[int] = []
    while len(picked) < min(limit, len(rows)):
        window = left[-_CANDIDATES:]
        best = max(
            range(len(window)), key=lambda at: _want(rows[window[at]], shares, taken, len(picked))
        )
        position = len(left) - len(window) + best
        index = left[position]
        left[position] = left[-1]
        left.pop()
        picked.append(index)
        taken.update((name, value) for name, (value, _) in rows[index].items())
        if len(left) > _CANDIDATES:
            _stir(left, len(picked))
    return sorted(picked)


def _stir(left: list[int], step: int) -> None:
    """Moves one row from below into the window that was just drawn from."""
    window = len(left) - _CANDIDATES
    swap = step * 7919 % window
    at = window + step % _CANDIDATES
    left[swap], left[at] = left[at], left[swap]


def _shares(
    rows: Sequence[Mapping[str, tuple[Hashable, float]]],
) -> dict[tuple[str, Hashable], float]:
    """The part of the sample that each value should be in, from 0 to 1, per variable."""
    weights: dict[str, dict[Hashable, float]] = defaultdict(dict)
    for row in rows:
        for name, (value, weight) in row.items():
            weights[name][value] = weight
    return {
        (name, value): weight / sum(of_name.values())
        for name, of_name in weights.items()
        for value, weight in of_name.items()
    }


def _want(
    row: Mapping[str, tuple[Hashable, float]],
    shares: Mapping[tuple[str, Hashable], float],
    taken: Mapping[tuple[str, Hashable], int],
    picked: int,
) -> float:
    keys = [(name, value) for name, (value, _) in row.items()]
    return sum(shares[key] * (picked + 1) - taken.get(key, 0) for key in keys)


def pairwise(rows: Sequence[Row]) -> list[int]:
    """Few rows that together hold every pair of values that any allowed row holds.

    allpairspy proposes them; what its search misses under exclusions is added here, so that the
    cover is whole.
    """
    names = list(rows[0])
    columns = [list(dict.fromkeys((type(row[n]).__name__, row[n]) for row in rows)) for n in names]
    places = [{value: place for place, value in enumerate(column)} for column in columns]
    coded = [
        tuple(places[at][type(row[n]).__name__, row[n]] for at, n in enumerate(names))
        for row in rows
    ]
    index_of = {row: index for index, row in reversed(list(enumerate(coded)))}
    picked = dict.fromkeys(index_of[row] for row in _proposed(columns, index_of))
    missing = set(itertools.chain.from_iterable(map(_pairs, coded)))
    for index in picked:
        missing -= _pairs(coded[index])
    for index, row in enumerate(coded):
        # The first row that holds a missing pair: simple, and seldom needed.
        if not missing:
            break
        new = missing & _pairs(row)
        if new:
            picked[index] = None
            missing -= new
    return sorted(picked)


def _proposed(
    columns: Sequence[Sequence[object]], allowed: Mapping[tuple[int, ...], int]
) -> list[tuple[int, ...]]:
    if len(columns) == 1:
        return [(place,) for place in range(len(columns[0]))]
    beginnings = {row[:length] for row in allowed for length in range(1, len(row) + 1)}
    search = AllPairs(
        [list(range(len(column))) for column in columns],
        filter_func=lambda row: tuple(row) in beginnings,
    )
    return [tuple(row) for row in search]


def _pairs(row: Sequence[int]) -> set[tuple[int, int, int, int]]:
    if len(row) == 1:
        return {(0, row[0], 0, row[0])}
    return {(a, row[a], b, row[b]) for a, b in itertools.combinations(range(len(row)), 2)}
