"""What is kept once, by whose it is, whatever is put and taken out in whichever order."""

from dataclasses import dataclass
from itertools import product

from hypothesis import given
from hypothesis import strategies as st

from bagpipe_operator.cluster.kept_once import KeptOnce


@dataclass(frozen=True)
class One:
    namespace: str
    name: str
    owner: str


ONES = st.builds(One, st.sampled_from("ab"), st.sampled_from("xyz"), st.sampled_from("123"))
STEPS = st.lists(st.tuples(st.sampled_from(["put", "take_out", "take_out_all"]), ONES))


@given(STEPS)
def test_it_is_a_table_by_namespace_and_name(steps: list[tuple[str, One]]) -> None:
    kept, table = KeptOnce[One](lambda one: one.owner), dict[tuple[str, str], One]()
    for step, one in steps:
        key = one.namespace, one.name
        if step == "put":
            kept.put(one)
            table[key] = one
        elif step == "take_out":
            kept.take_out(one)
            table.pop(key, None)
        else:
            kept.take_out_all(one.owner)
            table = {key: each for key, each in table.items() if each.owner != one.owner}
        assert (len(kept), set(kept)) == (len(table), set(table.values()))
        assert set(kept.owners()) == {each.owner for each in table.values()}
        assert kept.known(one) == table.get(key)
        for place, owner in product("ab", "123"):
            within = {k: o for k, o in table.items() if (o.namespace, o.owner) == (place, owner)}
            assert kept.within(place, owner) == within
            assert (place in kept.namespaces(owner)) is bool(within)
        for owner in "123":
            assert kept.of(owner) == {k: each for k, each in table.items() if each.owner == owner}
