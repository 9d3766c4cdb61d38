"""Layouts of viewers for a case's file: what is worth a panel of it."""

import json
from collections.abc import Sequence
from typing import Any
from xml.etree import ElementTree as ET

import yaml

from bagpipe.view.course import CRITERIA, LOG
from bagpipe.view.recording import Topic

_IMAGES = {"Image", "CompressedImage"}
_MOST_IMAGES = 4
# What RViz shows, by the message's name; the names of its own classes are the values.
_SHOWN = {
    "Image": "Image",
    "LaserScan": "LaserScan",
    "MarkerArray": "MarkerArray",
    "OccupancyGrid": "Map",
    "Odometry": "Odometry",
    "Path": "Path",
    "PointCloud2": "PointCloud2",
    "PoseArray": "PoseArray",
    "PoseStamped": "Pose",
}


def foxglove(topics: Sequence[Topic]) -> str:
    """A layout for Foxglove: the scene, images, each criterion's course, and the log."""
    images = [topic.name for topic in topics if _kind(topic) in _IMAGES][:_MOST_IMAGES]
    plots = [topic.name for topic in topics if topic.name.startswith(f"{CRITERIA}/")]
    panels: dict[str, Any] = {"3D!scene": {"layers": {}, "topics": _visible(topics)}}
    for number, image in enumerate(images):
        panels[f"Image!{number}"] = {"imageMode": {"imageTopic": image}}
    for number, plot in enumerate(plots):
        panels[f"Plot!{number}"] = _plot(plot)
    if any(topic.name == LOG for topic in topics):
        panels["RosOut!found"] = {"topicToRender": LOG}
    layout = {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": _mosaic(list(panels), "row"),
    }
    return json.dumps(layout, indent=1)


def plotjuggler(topics: Sequence[Topic]) -> str:
    """A layout for PlotJuggler: a plot for each criterion's course, with its bounds."""
    root = ET.Element("root")
    tabs = ET.SubElement(root, "tabbed_widget", {"name": "Main Window", "parent": "main_window"})
    plots = [topic.name for topic in topics if topic.name.startswith(f"{CRITERIA}/")]
    for plot in plots:
        title = plot.removeprefix(f"{CRITERIA}/")
        tab = ET.SubElement(tabs, "Tab", tab_name=title, containers="1")
        container = ET.SubElement(tab, "Container")
        split = ET.SubElement(container, "DockSplitter", orientation="-", sizes="1", count="1")
        area = ET.SubElement(split, "DockArea", name=title)
        curves = ET.SubElement(area, "plot", mode="TimeSeries", style="Lines")
        for field, colour in (("value", "#1f77b4"), ("low", "#d62728"), ("high", "#d62728")):
            ET.SubElement(curves, "curve", name=f"{plot}/{field}", color=colour)
    ET.SubElement(tabs, "currentTabIndex", index="0")
    ET.SubElement(root, "use_relative_time_offset", enabled="1")
    ET.indent(root)
    return ET.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def rviz(topics: Sequence[Topic], frame: str) -> str:
    """A configuration for RViz, of ROS 2 where messages are CDR: what it has displays for."""
    two = any(topic.encoding == "cdr" for topic in topics)
    package = "rviz_default_plugins" if two else "rviz"
    displays: list[dict[str, Any]] = [
        {"Class": f"{package}/Grid", "Name": "Grid", "Enabled": True},
        {"Class": f"{package}/TF", "Name": "TF", "Enabled": True},
    ]
    for topic in topics:
        shown = _SHOWN.get(_kind(topic))
        if shown is not None:
            named = {"Value": topic.name} if two else topic.name
            displays.append(
                {
                    "Class": f"{package}/{shown}",
                    "Name": topic.name,
                    "Enabled": True,
                    "Image Topic" if shown == "Image" and not two else "Topic": named,
                }
            )
    options = {"Fixed Frame": frame, "Background Color": "48; 48; 48"}
    manager = {"Class": "", "Displays": displays, "Enabled": True, "Global Options": options}
    text: str = yaml.safe_dump({"Visualization Manager": manager}, sort_keys=False)
    return text


def _kind(topic: Topic) -> str:
    return topic.type.rpartition("/")[2]


def _visible(topics: Sequence[Topic]) -> dict[str, Any]:
    return {topic.name: {"visible": True} for topic in topics if _SHOWN.get(_kind(topic))}


def _plot(topic: str) -> dict[str, Any]:
    fields = ("value", "low", "high")
    paths = [
        {"value": f"{topic}.{field}", "enabled": True, "timestampMethod": "receiveTime"}
        for field in fields
    ]
    return {
        "title": topic.removeprefix(f"{CRITERIA}/"),
        "paths": paths,
        "xAxisVal": "timestamp",
        "showLegend": True,
        "isSynced": True,
    }


def _mosaic(names: list[str], direction: str) -> Any:
    """Panels in halves: to the right, then below, and so on."""
    if len(names) == 1:
        return names[0]
    half = 1 if direction == "row" and len(names) > 2 else (len(names) + 1) // 2
    other = "column" if direction == "row" else "row"
    return {
        "direction": direction,
        "first": _mosaic(names[:half], other),
        "second": _mosaic(names[half:], other),
    }
