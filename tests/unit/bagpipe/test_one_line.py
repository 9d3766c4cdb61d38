"""Somebody else's words in one line."""

from bagpipe.one_line import one_line


def test_it_is_as_long_as_asked_for_at_most_and_shows_where_it_was_cut() -> None:
    assert one_line(" a\r\n b\tc ", 5) == "a b c"
    assert one_line("a b cd", 5) == "a b …"
    assert one_line("abcdef", 5) == "abc …"
    assert one_line(" \n ", 5) == ""
