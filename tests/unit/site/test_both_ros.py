"""A page that speaks of ROS 1's own things says what they are in ROS 2."""

import re

import pytest

from tests.unit.site.pages import DOCS

OF_ROS_1 = re.compile(r"\brosmaster\b|\broslaunch\b|\broscore\b|[\w*}]\.bag\b")
OF_ROS_2 = re.compile(r"\bROS 2\b|\bros2\b")
# Pages that speak of ROS 1's things and not of ROS 2, and why.
EXEMPT = {
    "tasks/another-simulator.md": "its cases have no ROS, neither of the two",
}
PAGES = {
    str(path.relative_to(DOCS)): path.read_text()
    for path in [
        *sorted(DOCS.glob("tasks/*.md")),
        *sorted(DOCS.glob("concepts/*.md")),
        DOCS / "start.md",
    ]
}


def lacks_ros_2(text: str) -> bool:
    return bool(OF_ROS_1.search(text)) and not OF_ROS_2.search(text)


def test_pages_for_users_say_both() -> None:
    assert len(PAGES) > 30
    silent = [name for name, text in PAGES.items() if lacks_ros_2(text) and name not in EXEMPT]
    assert silent == [], "say how it is in ROS 2, or why not, in EXEMPT"


def test_no_page_is_exempt_that_need_not_be() -> None:
    assert [name for name in EXEMPT if not lacks_ros_2(PAGES[name])] == []


@pytest.mark.parametrize(
    "text",
    [
        "The nodes find a `rosmaster`.",
        "command: [roslaunch, lane, lane.launch]",
        "Start roscore first.",
        'bags: ["s3://fleet/*.bag"]',
        "pvc://recordings/{{ scene }}.bag",
    ],
)
def test_what_is_of_ros_1_alone_is_found(text: str) -> None:
    assert lacks_ros_2(text)
    assert not lacks_ros_2(f"{text} # engine: ros2")
    assert not lacks_ros_2(f"In ROS 2 there is none. {text}")


@pytest.mark.parametrize("text", ["a bag's index", "bagpipe bag info", "launch", "drive.bags"])
def test_what_is_of_neither_is_not(text: str) -> None:
    assert not lacks_ros_2(text)
