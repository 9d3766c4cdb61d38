"""All stacks: those that lie, none of which may pass, and those that only look as if they did."""

from types import ModuleType

from tests.liars.classes import arithmetic, death, loss, order, programs, ros2, silence, time, wrong
from tests.liars.row import Row

CLASSES: list[ModuleType] = [time, arithmetic, silence, death, loss, order, wrong, programs, ros2]
ROWS: list[Row] = [row for part in CLASSES for row in [*part.LIARS, *part.HONEST]]
LIARS = [row for row in ROWS if not row.honest]
HONEST = [row for row in ROWS if row.honest]
# What the issue of a trustworthy pass began with: each of these six passed.
FIRST_SIX = [
    "wall-clock", "nan-from-the-tenth", "only-the-drain", "segfault", "two-answers", "nothing",
]  # fmt: skip
