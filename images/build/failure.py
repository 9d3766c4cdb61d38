"""How the building of images and wheels fails."""


class BuildError(Exception):
    """What was asked for could not be built; the message is for the user."""
