"""The machine that a worker is on, as the worker sees it: what figures of time depend on."""

import os
import platform
import socket
from functools import cache
from pathlib import Path
from typing import Any

_CPU_INFO = Path("/proc/cpuinfo")
# How the files of the architectures name a processor's model.
_MODEL_KEYS = ("model name", "Model", "Hardware", "cpu model")


@cache
def ran_on() -> dict[str, Any]:
    """Host (in a cluster the pod), processor, architecture, kernel, and how many processors."""
    try:
        cpu_info = _CPU_INFO.read_text(errors="replace")
    except OSError:
        cpu_info = ""
    return {
        "host": socket.gethostname(),
        "cpu": cpu_model(cpu_info),
        "arch": platform.machine(),
        "kernel": platform.release(),
        "cpus": os.cpu_count() or 0,
    }


def cpu_model(cpu_info: str) -> str:
    """The processor's model in the words of /proc/cpuinfo; empty where it names none."""
    found: dict[str, str] = {}
    for line in cpu_info.splitlines():
        key, _, value = line.partition(":")
        found.setdefault(key.strip(), " ".join(value.split())[:100])
    return next((found[key] for key in _MODEL_KEYS if found.get(key)), "")
