"""A Blender in a window of its own, with a hand on its mouse and keys and an eye on its screen.

Blender and the X server run inside a folder that `provision.py` made. Screen coordinates are pixels from the top left.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import time
from collections.abc import Callable
from difflib import SequenceMatcher
from pathlib import Path
from typing import Any

from PIL import Image

DRIVER = Path(__file__).with_name("driver.py")
WIDTH, HEIGHT = 1600, 1300
ALIKE = 0.75  # how far a word read from the screen may differ: one letter in four
ENLARGED = 3  # small letters are read better
SLOWEST = 60.0


Box = tuple[int, int, int, int]  # left, top, width, height


class NotSeenError(AssertionError):
    """A text is not on the screen."""


class Desk:
    """One Blender, from installing the zip to quitting.

    Parameters
    ----------
    root : Path
        A Debian with Blender.
    pictures : Path
        Folder outside it for the screenshots.
    """

    def __init__(self, root: Path, pictures: Path) -> None:
        self.root, self.pictures = root, pictures
        self.inside = f"/tmp/ctmc-{os.getpid()}"
        self.folder = Path(f"{root}{self.inside}")
        self.folder.mkdir(parents=True)
        pictures.mkdir(parents=True, exist_ok=True)
        for old in pictures.glob("*.png"):
            old.unlink()
        self.log = self.folder / "blender.log"
        self.questions = 0
        self.display, self.server, self.blender = "", None, None

    # Inside the folder ------------------------------------------------------------------------------------------

    def command(self, *words: str) -> list[str]:
        """A command line inside the folder."""
        variables = [
            f"HOME={self.inside}",
            f"BLENDER_USER_RESOURCES={self.inside}/profile",
            f"DISPLAY={self.display}",
            "LIBGL_ALWAYS_SOFTWARE=1",
            "LC_ALL=C.UTF-8",
            "PATH=/usr/local/bin:/usr/bin:/bin",
        ]
        return ["chroot", str(self.root), "env", "-i", *variables, *words]

    def call(self, *words: str) -> str:
        """Run a command inside the folder; what it printed."""
        done = subprocess.run(self.command(*words), capture_output=True, text=True, timeout=SLOWEST, check=False)
        assert done.returncode == 0, f"{' '.join(words)}: status {done.returncode}\n{done.stdout}\n{done.stderr}"
        return done.stdout

    def bring(self, source: Path) -> str:
        """Copy a file or folder in; its path there."""
        target = self.folder / source.name
        if source.is_dir():
            shutil.copytree(source, target)
        else:
            shutil.copyfile(source, target)
        return f"{self.inside}/{source.name}"

    def install(self, package: Path) -> str:
        """Install and enable an extension's zip as Blender's own command does."""
        zip_there = self.bring(package)
        return self.call(
            "blender", "-b", "--command", "extension", "install-file", "-r", "user_default", "-e", zip_there
        )

    # The window -------------------------------------------------------------------------------------------------

    def open(self) -> None:
        """Start the X server on a free display, and Blender on it; returns when Blender answers."""
        screen = ["-screen", "0", f"{WIDTH}x{HEIGHT}x24", "+extension", "GLX", "-nolisten", "tcp"]
        self.server = subprocess.Popen(
            self.command("Xvfb", "-displayfd", "1", *screen),
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        assert self.server.stdout is not None
        self.display = f":{self.server.stdout.readline().strip()}"
        driver = self.bring(DRIVER)
        window = ["--window-geometry", "0", "0", str(WIDTH), str(HEIGHT)]
        with self.log.open("w") as log:
            self.blender = subprocess.Popen(
                self.command("blender", *window, "-P", driver, "--", self.inside), stdout=log, stderr=subprocess.STDOUT
            )
        self.ask("answer = True")

    def close(self) -> int | None:
        """Quit Blender and clean up; Blender's exit status, None where it never started."""
        try:
            if self.blender is not None and self.blender.poll() is None:
                self.tell("bpy.ops.wm.quit_blender()")
                self.blender.wait(30)
        finally:
            for process in (self.blender, self.server):
                if process is not None and process.poll() is None:
                    process.kill()
                    process.wait()
            if self.server is not None and self.server.stdout is not None:
                self.server.stdout.close()
            if self.folder.exists():
                if self.log.exists():
                    shutil.copyfile(self.log, self.pictures / "blender.log")
                shutil.rmtree(self.folder)
        return None if self.blender is None else self.blender.returncode

    # Questions --------------------------------------------------------------------------------------------------

    def tell(self, source: str) -> Path:
        """Hand Blender a few lines of Python; where the answer will be."""
        part = self.folder / "ask.part"
        part.write_text(source, encoding="utf-8")
        part.rename(self.folder / f"ask-{self.questions}.py")
        self.questions += 1
        return self.folder / f"answer-{self.questions - 1}.json"

    def ask(self, source: str, seconds: float = SLOWEST) -> Any:
        """Run a few lines of Python in Blender and return what they leave in `answer`."""
        reply_file = self.tell(source)
        end = time.monotonic() + seconds
        while not reply_file.exists():
            assert self.blender is None or self.blender.poll() is None, f"Blender has ended:\n{self.last_words()}"
            assert time.monotonic() < end, f"Blender did not answer within {seconds:g} s:\n{source}"
            time.sleep(0.02)
        reply = json.loads(reply_file.read_text(encoding="utf-8"))
        assert "error" not in reply, reply["error"]
        return reply["answer"]

    def wait(self, expression: str, seconds: float = SLOWEST) -> Any:
        """Wait until a Python expression is true in Blender; its value."""
        end = time.monotonic() + seconds
        while not (value := self.ask(f"answer = {expression}")):
            assert time.monotonic() < end, f"not within {seconds:g} s: {expression}"
            time.sleep(0.1)
        return value

    def last_words(self) -> str:
        """The end of what Blender printed."""
        return self.log.read_text(encoding="utf-8", errors="replace")[-3000:]

    # Eye --------------------------------------------------------------------------------------------------------

    def look(self, name: str) -> Image.Image:
        """A picture of the whole screen, kept as `name`.png."""
        self.ask("answer = True")
        time.sleep(0.4)  # one redraw on the slow software GL
        self.call("import", "-window", "root", f"{self.inside}/{name}.png")
        shutil.move(self.folder / f"{name}.png", self.pictures / f"{name}.png")
        with Image.open(self.pictures / f"{name}.png") as picture:
            return picture.convert("RGB")

    def words(self, box: Box = (0, 0, WIDTH, HEIGHT)) -> list[tuple[str, int, int]]:
        """The words in a part of the screen, each with the place of its middle."""
        left, top, width, height = box
        size = f"{width}x{height}+{left}+{top}"
        shot = f"{self.inside}/words.png"
        self.call("import", "-window", "root", "-crop", size, "+repage", "-resize", f"{ENLARGED * 100}%",
                  "-colorspace", "gray", "-negate", shot)  # fmt: skip
        found = []
        for line in self.call("tesseract", shot, "-", "--psm", "11", "tsv").splitlines()[1:]:
            cells = line.split("\t")
            if len(cells) == 12 and cells[11].strip():
                x, y, width, height = (int(cell) / ENLARGED for cell in cells[6:10])
                found.append((cells[11].strip(), int(left + x + width / 2), int(top + y + height / 2)))
        return found

    def find(self, text: str, box: Box = (0, 0, WIDTH, HEIGHT)) -> tuple[int, int]:
        """Where a text of one or more words stands on the screen: the middle of its first word."""
        wanted = text.lower().split()
        words = self.words(box)
        for start in range(len(words)):
            run = words[start : start + len(wanted)]
            if len(run) == len(wanted) and all(
                SequenceMatcher(None, word.lower(), asked).ratio() >= ALIKE
                for (word, _, _), asked in zip(run, wanted, strict=True)
            ):
                return run[0][1], run[0][2]
        raise NotSeenError(f"{text!r} is not to be seen; there is: {' '.join(word for word, _, _ in words)}")

    # Hand -------------------------------------------------------------------------------------------------------

    def hand(self, *words: str) -> None:
        """One xdotool command line."""
        self.call("xdotool", *words)

    def move(self, x: int, y: int) -> None:
        """Move the mouse."""
        self.hand("mousemove", str(x), str(y))
        time.sleep(0.1)

    def click(self, x: int, y: int) -> None:
        """Click with the left button; Blender first has to see where the mouse is."""
        self.move(x - 2, y)
        self.move(x, y)
        self.hand("mousedown", "1")
        time.sleep(0.05)
        self.hand("mouseup", "1")

    def drag(self, start: tuple[int, int], end: tuple[int, int], during: Callable[[], None] | None = None) -> None:
        """Drag with the left button, in steps, as a hand does; `during` is called before letting go."""
        self.move(start[0] - 2, start[1])
        self.move(*start)
        self.hand("mousedown", "1")
        for step in range(1, 11):
            x, y = (round(a + (b - a) * step / 10) for a, b in zip(start, end, strict=True))
            self.move(x, y)
        if during is not None:
            during()
        self.hand("mouseup", "1")
        time.sleep(0.2)

    def press(self, key: str) -> None:
        """Press a key, where the mouse is."""
        self.hand("key", key)
