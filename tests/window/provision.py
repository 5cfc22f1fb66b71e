# SPDX-License-Identifier: GPL-3.0-or-later
"""A real Blender with a window, in a folder of its own under the user's cache: `provision.py SUITE` prints the folder.

Debian trixie brings Blender 4.3 (Python 3.13), sid brings 5.2 (Python 3.14). Nothing is mounted and nothing is
written outside the folder. It takes root and debootstrap, one to two minutes and 1.4 GB each, once. Debian's mirror is
the one this machine's own apt uses, or that of the variable CTMC_DEBIAN_MIRROR. Several checkouts share the folders:
a lock beside each lets many use it and one make it.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

SUITES = {"trixie": "4.3", "sid": "5.2"}
KEYRING = Path("/usr/share/keyrings/debian-archive-keyring.gpg")
WINDOW = ["xvfb", "xauth", "xdotool", "imagemagick", "libgl1-mesa-dri", "libgl1", "libegl1", "libglx-mesa0"]
# What Blender's extension manager imports; Debian leaves some of it to the reader.
PACKAGES = ["blender", "python3-numpy", "python3-requests", "python3-zstandard", *WINDOW]
EXTRA = {"trixie": [], "sid": ["python3-cattr"]}
STAMP = "ctmc-packages"
DESKS = "ctmc-desk-"  # begins the name of every test run's own folder, in the Debian's /tmp
ANSWER_LIMIT = 30.0  # seconds for the mirror's first answer
MAKE_LIMIT = 900.0  # seconds for any one of the commands below


class NoWindowError(Exception):
    """This machine cannot provide a Blender with a window; one sentence that says why."""


def cache_folder() -> Path:
    """Where the Blenders are kept between runs."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "ctmc" / "window"


def require_means() -> None:
    """Raise `NoWindowError` where a Blender cannot be provided or entered; installs debootstrap where it may."""
    if not sys.platform.startswith("linux") or os.geteuid() != 0:
        raise NoWindowError("it needs root on Linux, to make a Debian in a folder and enter it")
    if shutil.which("debootstrap") is None and not all(is_ready(suite) for suite in SUITES):
        if shutil.which("apt-get"):
            subprocess.run(["apt-get", "update", "-qq"], check=False, stdout=subprocess.DEVNULL)
            install = ["apt-get", "install", "-y", "-qq", "--no-install-recommends", "debootstrap"]
            subprocess.run(install, check=False, stdout=subprocess.DEVNULL)
        if shutil.which("debootstrap") is None:
            raise NoWindowError("it needs debootstrap, which apt-get could not install")


def mirror() -> str:
    """The Debian mirror that this machine's apt uses."""
    chosen = os.environ.get("CTMC_DEBIAN_MIRROR")
    if chosen:
        return chosen
    folder = Path("/etc/apt")
    files = [*sorted(folder.glob("sources.list.d/*.sources")), *sorted(folder.glob("sources.list.d/*.list"))]
    for file in [*files, folder / "sources.list"]:
        text = file.read_text(encoding="utf-8") if file.is_file() else ""
        for address in re.findall(r"^(?:URIs:|deb(?: \[[^]]*\])?)\s+(\S+/debian/?)(?:\s|$)", text, re.MULTILINE):
            return str(address)
    raise NoWindowError("this machine's apt knows no Debian mirror; name one in CTMC_DEBIAN_MIRROR")


def packages(suite: str) -> str:
    """The packages of a suite, as kept in the stamp of a finished folder."""
    return " ".join([*PACKAGES, *EXTRA[suite]])


def is_ready(suite: str) -> bool:
    """Whether the suite's folder is there, whole, and made from the present list of packages."""
    stamp = cache_folder() / suite / STAMP
    return stamp.is_file() and stamp.read_text(encoding="utf-8") == packages(suite)


def open_lock(suite: str) -> IO[str]:
    """The lock of a suite's folder, not yet taken."""
    cache_folder().mkdir(parents=True, exist_ok=True)
    return (cache_folder() / f"{suite}.lock").open("w")


@contextmanager
def used(suite: str) -> Iterator[Path]:
    """The folder to chroot into, which nobody makes anew meanwhile; `NoWindowError` where it is not there."""
    import fcntl  # not on Windows, where this module is imported but cannot be used

    with open_lock(suite) as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            pass
        else:  # nobody else is in it: take away what runs that were killed have left
            for desk in (cache_folder() / suite / "tmp").glob(f"{DESKS}*"):
                shutil.rmtree(desk)
        fcntl.flock(lock, fcntl.LOCK_SH)
        if not is_ready(suite):
            raise NoWindowError(f"Debian {suite} is not provided")
        yield cache_folder() / suite


def provide(suite: str) -> None:
    """Make the folder of a suite when it is not there yet; `NoWindowError` where that cannot be done."""
    if is_ready(suite):
        return
    import fcntl  # as above

    with open_lock(suite) as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not is_ready(suite):  # another run may have made it while this one waited
            make(suite)


def make(suite: str) -> None:
    """Debootstrap a suite and install Blender in it."""
    root, address = cache_folder() / suite, mirror()
    require_answer(f"{address.rstrip('/')}/dists/{suite}/Release")
    print(f"Making a Debian {suite} with Blender {SUITES[suite]} in {root} (one to two minutes)", flush=True)
    part = root.with_name(f"{suite}.part")
    for old in (part, root):
        if old.exists():
            shutil.rmtree(old)
    part.mkdir(parents=True)
    call("debootstrap", "--variant=minbase", f"--keyring={KEYRING}", suite, str(part), address)
    for file in Path("/etc/apt/apt.conf.d").iterdir():
        shutil.copy(file, part / "etc/apt/apt.conf.d")
    for file in (Path("/etc/resolv.conf"), Path("/etc/hosts")):
        shutil.copy(file, part / "etc")
    call("chroot", str(part), "apt-get", "update", "-qq")
    install = ["apt-get", "install", "-y", "-qq", "--no-install-recommends", *PACKAGES, *EXTRA[suite]]
    call("chroot", str(part), *install)
    call("chroot", str(part), "apt-get", "clean")
    (part / STAMP).write_text(packages(suite), encoding="utf-8")
    part.rename(root)


def require_answer(address: str) -> None:
    """Raise `NoWindowError` where the mirror does not answer, before anything waits for it."""
    try:
        with urllib.request.urlopen(address, timeout=ANSWER_LIMIT):
            pass
    except (OSError, urllib.error.URLError) as error:
        raise NoWindowError(f"{address} does not answer ({error})") from None


def call(*command: str) -> None:
    """Run a command quietly; `NoWindowError` with the last line it said when it fails."""
    quiet = {**os.environ, "DEBIAN_FRONTEND": "noninteractive", "LC_ALL": "C"}
    name = " ".join(command[:3])
    try:
        done = subprocess.run(
            command,
            env=quiet,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=MAKE_LIMIT,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise NoWindowError(f"{name} took longer than {MAKE_LIMIT:g} s") from None
    if done.returncode != 0:
        said = done.stdout.strip().splitlines() or ["nothing"]
        raise NoWindowError(f"{name} ended with status {done.returncode} and said: {said[-1]}")


if __name__ == "__main__":
    require_means()
    for name in sys.argv[1:] or SUITES:
        provide(name)
        print(cache_folder() / name)
