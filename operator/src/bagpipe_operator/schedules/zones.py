"""The time zones that schedules name, read without holding the event loop up."""

import asyncio
from dataclasses import dataclass, field
from zoneinfo import ZoneInfo

from bagpipe_operator.schedules.cron import read_zone


@dataclass
class Zones:
    """Each zone is a file, and is read once: there are some hundred. What is none is not kept."""

    _known: dict[str, ZoneInfo] = field(default_factory=dict)

    async def read(self, name: str) -> ZoneInfo | None:
        """The zone of that name, or None where there is none."""
        zone = self._known.get(name) or await asyncio.to_thread(read_zone, name)
        if zone is not None:
            self._known[name] = zone
        return zone
