"""Notifications: signed, sent to each receiver at its own pace, tried again, counted."""
