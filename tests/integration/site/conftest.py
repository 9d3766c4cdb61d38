"""The browser for the documentation's site."""

from tests.integration.chromium import browser

__all__ = ["browser"]
