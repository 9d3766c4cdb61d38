"""A release: all that registries and package indexes take, from one checkout, into one folder.

`make release` and `make push` run it; docs/operations/release.md says what comes out.
"""


class ReleaseError(Exception):
    """A release could not be made or pushed; the message is for the user."""
