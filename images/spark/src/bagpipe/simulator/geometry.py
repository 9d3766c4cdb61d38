"""Whether rectangles on the ground overlap, and how far a ray goes until it meets one."""

import math

from bagpipe.simulator.actors import Body

Corner = tuple[float, float]


def corners(body: Body) -> list[Corner]:
    """The four corners, around."""
    cos, sin = math.cos(body.heading), math.sin(body.heading)
    ahead, aside = body.length / 2, body.width / 2
    return [
        (body.x + a * cos - b * sin, body.y + a * sin + b * cos)
        for a, b in ((ahead, aside), (-ahead, aside), (-ahead, -aside), (ahead, -aside))
    ]


def overlap(one: Body, other: Body) -> bool:
    """Whether two rectangles share a point: no line along a side of either lies between them."""
    dx, dy = other.x - one.x, other.y - one.y
    reach = (math.hypot(one.length, one.width) + math.hypot(other.length, other.width)) / 2
    if dx * dx + dy * dy > reach * reach:
        return False
    return not any(_apart(one, other, dx, dy, body) for body in (one, other))


def _apart(one: Body, other: Body, dx: float, dy: float, along: Body) -> bool:
    cos, sin = math.cos(along.heading), math.sin(along.heading)
    for ux, uy in ((cos, sin), (-sin, cos)):
        gap = abs(dx * ux + dy * uy)
        if gap > _extent(one, ux, uy) + _extent(other, ux, uy):
            return True
    return False


def _extent(body: Body, ux: float, uy: float) -> float:
    cos, sin = math.cos(body.heading), math.sin(body.heading)
    return body.length / 2 * abs(cos * ux + sin * uy) + body.width / 2 * abs(-sin * ux + cos * uy)
