"""Many questions at once: by chance one in twenty looks like a find, unless that is corrected.

Holm's correction (1979) holds whatever the questions have to do with each other. Where a question
can't be answered at all with the evidence at hand, since even the clearest answer would be likely
by chance, it takes nothing from the others (Tarone 1990).
"""

import itertools
from collections.abc import Sequence


def holm(chances: Sequence[float]) -> list[float]:
    """Each question's corrected chance, in the same order: at most `level` is a find."""
    order = sorted(range(len(chances)), key=chances.__getitem__)
    shares = (min(1.0, (len(order) - place) * chances[at]) for place, at in enumerate(order))
    corrected = dict(zip(order, itertools.accumulate(shares, max), strict=True))
    return [corrected[at] for at in range(len(chances))]


def family_size(least: Sequence[float], level: float) -> int:
    """By how many questions `level` is shared; `least` are the least chances that each can have.

    Those whose least chance is above their share of the level are not among them. (Tarone)
    """
    size = 1
    while sum(chance <= level / size for chance in least) > size:
        size += 1
    return size
