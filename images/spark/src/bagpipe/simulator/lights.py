"""Traffic lights: what each shows at a time."""

from bagpipe.simulator.scenario import Light, Scene

# As numbers in a message, in the order of the scene's lights.
COLOURS = {"red": 0, "yellow": 1, "green": 2}


def shown(scene: Scene, seconds: float) -> list[int]:
    """One of COLOURS for each of the scene's lights."""
    return [COLOURS[colour(light, seconds)] for light in scene.lights]


def colour(light: Light, seconds: float) -> str:
    """What one light shows, `seconds` after the start."""
    # Whole milliseconds: the end of a phase must not hang on the last bit of a sum.
    lengths = [round(phase.seconds * 1000) for phase in light.program]
    left = round(seconds * 1000) % max(sum(lengths), 1)
    for phase, length in zip(light.program, lengths, strict=True):
        if left < length:
            return phase.shows
        left -= length
    return light.program[-1].shows
