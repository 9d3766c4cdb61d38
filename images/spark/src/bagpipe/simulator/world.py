"""The simulated world: turn by turn, what the stack sees next in answer to what it asked for.

Pure but for its own state: the same scenario and the same answers give the same bytes.
"""

import math
from dataclasses import dataclass
from typing import Any, Protocol

from bagpipe.simulator import messages
from bagpipe.simulator.actors import Body, Course
from bagpipe.simulator.geometry import overlap
from bagpipe.simulator.lidar import Scanner
from bagpipe.simulator.lights import shown
from bagpipe.simulator.markers import markers
from bagpipe.simulator.messages import Publication, publication, wish
from bagpipe.simulator.model import START, Simulator, Topics
from bagpipe.simulator.scenario import Scenario
from bagpipe.simulator.serialisation import Serialisation
from bagpipe.simulator.vehicle import SUBSTEP, Vehicle, Wish

# With each deadline of 2 s a stack that is deaf costs 40 s of its case, and no more.
MOST_UNANSWERED = 20


class NeverAnsweredError(Exception):
    """The stack does not steer; the sentence is for the user."""


@dataclass(frozen=True)
class Steering:
    """What the stack is asked: when an answer is due after which topics, and if it must come."""

    triggers: frozenset[str]
    required: bool


class Beside(Protocol):
    """What else is published during the drive."""

    @property
    def publications(self) -> list[Publication]:
        """The topics on which it is."""

    def due(self, time: int, /) -> list[tuple[str, bytes]]:
        """Topics and messages that are due at `time` (ns) and were not before."""


class World:
    """One drive, from `model.START` on."""

    def __init__(
        self,
        simulator: Simulator,
        scenario: Scenario,
        steering: Steering,
        own: Serialisation,
        beside: Beside | None = None,
    ) -> None:
        self._simulator, self._scenario, self._steering = simulator, scenario, steering
        scene, ego = scenario.scene, scenario.ego
        self.car = Vehicle(ego, ego.lane * scene.lane_width)
        self._courses = [Course(actor, ego, scene) for actor in scenario.actors]
        self._barriers = [Body(b.x, b.y, b.heading, b.length, b.width) for b in scene.barriers]
        self._scanner = Scanner(scenario.lidar) if scenario.lidar else None
        self._wish = Wish(ego.speed, 0.0)
        self._number = 0
        self._unanswered = 0
        self._due = False
        self.collided = False
        self._beside, self._own = beside, own
        self.publications = publications(own, simulator.topics, scenario)
        if beside is not None:
            self.publications += beside.publications
        self._places = {each.topic: place for place, each in enumerate(self.publications)}

    def step(self, answer: dict[str, Any]) -> dict[str, Any] | None:
        """STEP's map after ANSWER's, None at the end.

        Raises ControlError and NeverAnsweredError.
        """
        self._obey(answer)
        if self._number == self._simulator.steps:
            return None
        if self._number:
            self._move()
        # What was recorded is not later than this moment, and comes first.
        recorded = self._beside.due(self._time(self._number)) if self._beside else []
        spoken = recorded + self._speak()
        self._number += 1
        self._due = self._steering.triggers <= {topic for topic, _ in spoken}
        return {
            "time": self._time(self._number - 1),
            "messages": [[self._places[topic], data] for topic, data in spoken],
        }

    def _time(self, number: int) -> int:
        return START + number * self._simulator.step_nanoseconds

    def _obey(self, answer: dict[str, Any]) -> None:
        control = self._simulator.topics.control
        commands = [(kind, data) for topic, kind, data in answer["messages"] if topic == control]
        for kind, data in commands:
            self._wish = wish(self._own, control, kind, data)
        if commands:
            self._unanswered = 0
        elif self._due and self._steering.required:
            self._unanswered += 1
        if self._unanswered >= MOST_UNANSWERED:
            raise NeverAnsweredError(
                f"the stack did not answer on {control} in {self._unanswered} steps in a row, up to"
                f" {self._seconds():g} s of the drive: does its node publish after"
                " every message that playback.steps name as a trigger?"
            )

    def _seconds(self) -> float:
        return self._number * self._simulator.step_nanoseconds / 1e9

    def _move(self) -> None:
        """From the moment before to this one; whoever meets on the way has collided."""
        step = self._simulator.step_nanoseconds / 1e9
        parts = math.ceil(step / SUBSTEP - 1e-9)
        begun = self._seconds() - step
        for part in range(1, parts + 1):
            self.car.advance(self._wish, step / parts)
            if not self.collided:
                self.collided = self._touches(begun + part * step / parts)

    def _touches(self, seconds: float) -> bool:
        pose = self.car.pose
        own = Body(pose.x, pose.y, pose.heading, self.car.length, self.car.width)
        return any(overlap(own, body) for body in self._others(seconds))

    def _others(self, seconds: float) -> list[Body]:
        return [course.at(seconds) for course in self._courses] + self._barriers

    def _speak(self) -> list[tuple[str, bytes]]:
        """What is published at this moment, in the order in which it goes out."""
        number, time, seconds = self._number, self._time(self._number), self._seconds()
        own = self._own
        names, pose, others = self._simulator.topics, self.car.pose, self._others(seconds)
        if not number:
            self.collided = self._touches(0.0)
        spoken = [(names.collision, messages.flag(own, self.collided))]
        if not number:
            spoken.append((names.scene, markers(own, self._scenario.scene, time)))
        if self._scenario.scene.lights:
            spoken.append(
                (names.lights, messages.lights(own, shown(self._scenario.scene, seconds)))
            )
        if self._scanner and self._scenario.lidar and number % self._scenario.lidar.every == 0:
            points = self._scanner.points(pose, others)
            spoken.append((names.points, messages.cloud(own, number, time, points)))
        spoken.append((names.obstacles, messages.poses(own, number, time, others)))
        spoken.append((names.odometry, messages.odometry(own, number, time, pose)))
        return spoken


def publications(own: Serialisation, names: Topics, scenario: Scenario) -> list[Publication]:
    """What a scenario's simulator speaks on."""
    made = [
        publication(own, names.collision, messages.FLAG),
        publication(own, names.scene, messages.MARKERS, latching=True),
        publication(own, names.obstacles, messages.POSES),
        publication(own, names.odometry, messages.ODOMETRY),
    ]
    if scenario.scene.lights:
        made.append(publication(own, names.lights, messages.LIGHTS))
    if scenario.lidar:
        made.append(publication(own, names.points, messages.CLOUD))
    return made
