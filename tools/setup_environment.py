# SPDX-License-Identifier: GPL-3.0-or-later
"""Make the environment in which this checkout runs: .venv/ with Blender as a Python module, and `ctmc`.

Standard library only, and any Python 3 may start it: it looks for a Python that Blender has a wheel for.
Does nothing, quickly, when the environment is up to date. `--bpy VERSION` makes .venvs/bpy-VERSION/ instead,
an environment for the tests in one of the Blender versions below.
"""

from __future__ import annotations

import argparse
import ctypes.util
import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
NO_PYTHON = (
    "Blender's Python module exists for Python 3.11 (Blender 4.2 to 5.0) and Python 3.13 (Blender 5.1 and later)"
)
PYTHONS = ("3.11", "3.13")
BLENDERS = {  # Python and extra packages of each Blender version in which the tests run.
    "4.2.23": ("3.11", ["numpy==1.24.3"]),  # Blender 4.2 has this NumPy.
    "4.5.15": ("3.11", []),
    "5.0.1": ("3.11", []),
    "5.2.3": ("3.13", []),
}
# Without libEGL a GPU engine aborts the process, so it is asked for here and not found out there.
LIBRARIES = {
    "X11": "libx11-6",
    "Xrender": "libxrender1",
    "Xfixes": "libxfixes3",
    "Xi": "libxi6",
    "Xxf86vm": "libxxf86vm1",
    "xkbcommon": "libxkbcommon0",
    "SM": "libsm6",
    "GL": "libgl1",
    "EGL": "libegl1",
    "gomp": "libgomp1",
}


class SetupError(Exception):
    """A sentence for the person who sets up."""


def say(message: str) -> None:
    """Print a line at once, so that a long step is announced before it runs."""
    print(message, flush=True)


def run(command: list[str], failure: str, **environment: str) -> None:
    """Run a command quietly; only if it fails is its output shown."""
    env = {**os.environ, **environment}
    done = subprocess.run(
        command, env=env, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False
    )
    if done.returncode:
        sys.stdout.write(done.stdout.decode(errors="replace"))
        raise SetupError(failure)


def python_version(python: str) -> str | None:
    """Return the version of an interpreter, such as `3.11`; None if it does not run, as some shims do not."""
    command = [python, "-c", "import sys; print('%d.%d' % sys.version_info[:2])"]
    try:
        done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, timeout=60, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return None
    return done.stdout.decode().strip() if done.returncode == 0 else None


def find_python(suitable: tuple[str, ...], asked: str) -> tuple[str, str]:
    """Return the interpreter and its version: the requested one, else the first suitable one."""
    if asked:
        version = python_version(asked)
        if version is None:
            raise SetupError(
                f"PYTHON={asked} does not run as a Python; give the path of a Python {' or '.join(suitable)}"
            )
        if version not in suitable:
            raise SetupError(f"PYTHON={asked} is Python {version}, but {NO_PYTHON}")
        return asked, version
    pyenv = Path(os.environ.get("PYENV_ROOT") or Path.home() / ".pyenv") / "versions"
    names = ["python3", *(f"python{version}" for version in suitable)]
    names += [str(path) for version in suitable for path in sorted(pyenv.glob(f"{version}.*/bin/python"))]
    for name in names:
        path = shutil.which(name)
        version = python_version(path) if path else None
        if path and version in suitable:
            return path, version
    raise SetupError(
        f"No Python {' or '.join(suitable)} was found: {NO_PYTHON}; install one, or give PYTHON=/path/to/python"
    )


def missing_packages(python: str, version: str) -> list[str]:
    """Return the missing Debian packages for Blender and for environments."""
    packages = [package for library, package in LIBRARIES.items() if ctypes.util.find_library(library) is None]
    probe = subprocess.run([python, "-c", "import ensurepip, venv"], capture_output=True, check=False)
    if probe.returncode:
        packages.append(f"python{version}-venv")
    return packages


def install_packages(packages: list[str]) -> None:
    """Install Debian packages if no password is needed, else print the command."""
    by_hand = f"sudo apt-get install -y --no-install-recommends {' '.join(packages)}"
    if shutil.which("apt-get") is None:
        raise SetupError(f"System libraries are missing, which Debian would install with: {by_hand}")
    sudo: list[str] = []
    if sys.platform != "win32" and os.geteuid() != 0:
        sudo = ["sudo", "-n"]
        may = shutil.which("sudo") and subprocess.run([*sudo, "true"], capture_output=True, check=False).returncode == 0
        if not may:
            raise SetupError(f"System libraries are missing; install them with: {by_hand}")
    say(f"Installing system packages: {' '.join(packages)}")
    apt = [*sudo, "env", "DEBIAN_FRONTEND=noninteractive", "apt-get", "-qq"]
    install = [*apt, "install", "-y", "--no-install-recommends", *packages]
    if subprocess.run(install, stdin=subprocess.DEVNULL, capture_output=True, check=False).returncode == 0:
        return  # the package lists were recent enough
    run([*apt, "update"], "apt-get could not update its package lists")
    run(install, f"apt-get could not install the system libraries; try: {by_hand}")


def prepare_system(python: str, version: str) -> None:
    """Install the libraries that Blender and the environment need; on Linux only."""
    if not sys.platform.startswith("linux"):
        return
    packages = missing_packages(python, version)
    if packages:
        install_packages(packages)
        if still := missing_packages(python, version):
            raise SetupError(f"The system does not find what these packages hold: {' '.join(still)}")


def make_environment(folder: Path, python: str, stamp: str, requirements: list[str]) -> None:
    """Make a new virtual environment with this checkout, editable, and everything it needs."""
    say(f"Setting up {folder.relative_to(ROOT)} with {stamp.splitlines()[0]}; up to some minutes and 2 GB")
    shutil.rmtree(folder, ignore_errors=True)
    run([python, "-m", "venv", str(folder)], f"{python} could not make the environment {folder}")
    pip = [str(environment_python(folder)), "-m", "pip", "install", "--quiet", "--no-input"]
    run([*pip, *requirements], f"pip could not install what {folder.name} needs", PIP_DISABLE_PIP_VERSION_CHECK="1")
    (folder / "stamp.txt").write_text(stamp, encoding="utf-8")


def environment_python(folder: Path) -> Path:
    """Return the interpreter of a virtual environment."""
    return folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")


def set_up(bpy: str = "", asked: str = "") -> Path:
    """Make the environment of this checkout, or of one Blender version, unless it is up to date; returns its Python."""
    if bpy and bpy not in BLENDERS:
        raise SetupError(f"Blender {bpy} is not among the tested versions {', '.join(BLENDERS)}")
    if bpy:
        folder = ROOT / ".venvs" / f"bpy-{bpy}"
        version, further = BLENDERS[bpy]
        python, version = find_python((version,), "")
        requirements = [f"bpy=={bpy}", *further, "--editable", f"{ROOT}[test]"]
    else:
        folder = ROOT / ".venv"
        python, version = find_python(PYTHONS, asked)
        requirements = ["--editable", f"{ROOT}[blender,test,peers,lint,zarr]"]
    # The folder is part of the stamp: an environment does not survive being moved.
    project = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    stamp = f"Python {version}\n{folder}\n{requirements}\n{project}"
    prepare_system(python, version)
    done = folder / "stamp.txt"
    if not (done.is_file() and done.read_text(encoding="utf-8") == stamp and environment_python(folder).exists()):
        make_environment(folder, python, stamp, requirements)
    return environment_python(folder)


def main() -> int:
    """Set up; 1 and one sentence if that cannot be done here."""
    parser = argparse.ArgumentParser(description="Make .venv, or the environment of one Blender version.")
    parser.add_argument("--bpy", default="", help=f"one of {', '.join(BLENDERS)}, or its beginning, into .venvs/")
    asked = parser.parse_args().bpy
    bpy = next((version for version in BLENDERS if asked and version.startswith(asked)), asked)
    try:
        set_up(bpy, os.environ.get("PYTHON", ""))
    except SetupError as error:
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
