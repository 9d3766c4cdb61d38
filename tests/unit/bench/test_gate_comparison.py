"""Comparisons whose truth is known: few false alarms, and real shifts are found."""

from tests.bench.gate_comparison import A_A, ONE, interval, report, shares

COMPARISONS = 300


def test_a_version_against_itself_gives_few_alarms_and_half_a_deviation_is_found() -> None:
    quiet = shares(A_A, COMPARISONS)
    assert interval(quiet["bagpipe"], COMPARISONS)[0] < 0.05
    assert quiet["bagpipe"] == 11
    # What others do: one in twenty for each of ten criteria, of pairs that are not independent.
    assert quiet["naive pairs"] == 220
    assert quiet["lower pass rate"] == 127
    loud = shares(ONE, COMPARISONS)
    assert interval(loud["bagpipe"], COMPARISONS)[1] > 0.8
    assert loud["bagpipe"] == 247
    assert loud["pass rates, tested"] == 0


def test_the_table_says_what_is_a_false_alarm_and_what_a_find() -> None:
    text = report({A_A: {"bagpipe": 5}, ONE: {"bagpipe": 80}}, 100)
    assert "| A/A, 10 criteria: false alarms | 5.0% (1.6% to 11.3%) |" in text
    assert "1 criterion: found | 80.0% (70.8% to 87.3%) |" in text
