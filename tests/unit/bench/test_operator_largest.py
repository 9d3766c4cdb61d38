"""The list of jobs that no etcd holds reads as a real one would."""

import json
from typing import Any

import pytest

from tests.bench.operator_largest import Listing

TEMPLATE: dict[str, Any] = {
    "apiVersion": "sim.bagpipe.io/v1alpha1",
    "kind": "SimulationJob",
    "metadata": {"name": "largest", "namespace": "bench", "uid": "u", "resourceVersion": "7"},
    "spec": {"suspend": True, "stack": {"parameters": {"/x": [[], []]}}},
    "status": {"phase": "Suspended"},
}


def page(listing: Listing, begin: int, limit: int, partial: bool = False) -> Any:
    return json.loads(b"".join(listing.page(begin, limit, partial)))


def test_the_pages_together_hold_each_job_once() -> None:
    listing, begin, found = Listing(TEMPLATE, 5), 0, []
    for _ in range(3):
        read = page(listing, begin, 2)
        found += read["items"]
        begin = int(read["metadata"].get("continue", 0))
    assert begin == 0
    names = [item["metadata"]["name"] for item in found]
    assert names == [f"largest-{number}" for number in range(5)]
    assert len({item["metadata"]["uid"] for item in found}) == 5
    assert all(item["spec"] == TEMPLATE["spec"] for item in found)
    assert all(item["status"] == TEMPLATE["status"] for item in found)


@pytest.mark.parametrize("limit", [0, 3, 20])
def test_a_list_without_a_next_page_says_so(limit: int) -> None:
    read = page(Listing(TEMPLATE, 3), 0, limit)
    assert len(read["items"]) == 3
    assert "continue" not in read["metadata"]


def test_who_asks_for_metadata_alone_gets_no_specs() -> None:
    assert {key for item in page(Listing(TEMPLATE, 3), 0, 0, True)["items"] for key in item} == {
        "metadata"
    }
