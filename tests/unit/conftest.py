"""Properties are tested on machines that may be busy: time is not what they are about."""

from hypothesis import HealthCheck, settings

# Hypothesis's own limits are 200 ms for an example and some seconds for making a few of them.
settings.register_profile("busy", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("busy")
