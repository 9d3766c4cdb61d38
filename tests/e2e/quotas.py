"""A namespace whose quota is used up, and what Spark says of it."""

import json
from collections.abc import Iterator
from contextlib import contextmanager

from tests.e2e import kubectl as k


@contextmanager
def quota(namespace: str, more: int) -> Iterator[None]:
    """Room for so many more pods, once those of earlier jobs are gone."""

    def others() -> list[str]:
        found = (pod["metadata"]["name"] for pod in k.items(namespace, "pods"))
        return [name for name in found if name != k.TOOLBOX]

    k.await_that("the pods of earlier jobs to go", lambda: not others(), 300)
    limit = {
        "apiVersion": "v1",
        "kind": "ResourceQuota",
        "metadata": {"name": "small"},
        "spec": {"hard": {"pods": str(1 + more)}},
    }
    k.kubectl("-n", namespace, "apply", "-f", "-", given=json.dumps(limit))
    k.await_that(
        "the quota to count",
        lambda: k.get(namespace, "resourcequota", "small").get("status", {}).get("used"),
        120,
    )
    try:
        yield
    finally:
        k.kubectl("-n", namespace, "delete", "resourcequota", "small")


def refusals(log: str) -> list[str]:
    """The first line of each second in which Spark was refused an executor for quota."""
    lines = [line for line in log.splitlines() if "exceeded quota" in line]
    return list({line[: len("2026-01-01T00:00:00")]: line for line in reversed(lines)}.values())
