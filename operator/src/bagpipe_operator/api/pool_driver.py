"""Which of a job's own pods may run another job after it, as its status says. Pure."""

from bagpipe_operator.api import names, readings
from bagpipe_operator.api.objects import Json


def own_driver_in_pool(name: str, status: Json) -> str:
    """The pod of a job's last driver where it was made for it and may wait; empty for none."""
    own = names.driver_name(name, readings.whole(status.get("attempt")) or 1)
    return own if status.get("pool") and status.get("driver") == own else ""
