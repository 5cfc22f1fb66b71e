# SPDX-License-Identifier: GPL-3.0-or-later
"""Name what a measurement depends on: processor, cores, system and versions, but not the machine's own name."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from pathlib import Path

import numpy as np

from ...core import VERSION


def machine() -> str:
    """Return processor, cores and system, such as 'Intel Xeon E5, 2 cores, Debian GNU/Linux 12'."""
    cores = os.cpu_count() or 1
    return f"{processor()}, {cores} {'core' if cores == 1 else 'cores'}, {system()}"


def versions() -> str:
    """Return the versions of CTMC, Blender if it is running, NumPy and Python."""
    bpy = sys.modules.get("bpy")
    blender = f"Blender {bpy.app.version_string}, " if bpy else ""
    return f"CTMC {VERSION}, {blender}NumPy {np.__version__}, Python {platform.python_version()}"


def processor() -> str:
    """Return the processor's name as the system knows it, else its architecture."""
    if sys.platform == "win32":
        import winreg

        with winreg.OpenKey(winreg.HKEY_LOCAL_MACHINE, r"HARDWARE\DESCRIPTION\System\CentralProcessor\0") as key:
            return " ".join(str(winreg.QueryValueEx(key, "ProcessorNameString")[0]).split())
    if sys.platform == "darwin":
        done = subprocess.run(
            ["sysctl", "-n", "machdep.cpu.brand_string"], capture_output=True, text=True, timeout=10, check=False
        )
        return done.stdout.strip() or platform.machine()
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text("utf-8", "replace").splitlines() if cpuinfo.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()


def system() -> str:
    """Return the operating system with its version."""
    if sys.platform == "darwin":
        return f"macOS {platform.mac_ver()[0]}"
    if sys.platform == "win32":
        return f"Windows {platform.version()}"
    try:
        return platform.freedesktop_os_release()["PRETTY_NAME"]
    except (OSError, KeyError):
        return f"{platform.system()} {platform.release()}"
