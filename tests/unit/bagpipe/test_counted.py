"""Numbers of things in sentences."""

from bagpipe.counted import counted


def test_only_one_thing_is_no_plural() -> None:
    numbers = [counted(count, "case") for count in (0, 1, 2, 1000)]
    assert numbers == ["0 cases", "1 case", "2 cases", "1,000 cases"]
