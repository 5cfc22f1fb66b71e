# SPDX-License-Identifier: GPL-3.0-or-later
"""A Blender in a window of its own, with a hand on its mouse and keys and an eye on its screen.

Blender and the X server run inside a folder that `provision.py` made. Screen coordinates are pixels from the top left.
Nothing waits for a time: every movement is followed by a question, and Blender answers it only once it has handled and
drawn what came before (`driver.py`). The limits below only end a test of a Blender that hangs.
"""

from __future__ import annotations

import json
import shutil
import struct
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

from PIL import Image
from window.provision import DESKS

DRIVER = Path(__file__).with_name("driver.py")
WIDTH, HEIGHT = 1200, 1200
LIMIT = 120.0  # seconds; a busy machine may need many
LOOK_AGAIN = 0.002  # seconds between two looks for an answer
DRAG_STEPS = 6
SCAN = 16  # pixels; buttons are at least 22 high
NOTCHES = 20  # clicks of the wheel from one look at the sidebar to the next
LOOKS = 5
PAGES = ("CT", "SURFACE", "DRAW", "RESULTS", "RENDER")
# Buttons that are on one page alone: to go over another page with the mouse takes a second of drawing.
PAGE_OF = {
    **{f"bpy.ops.ctmc.{name}": "SURFACE" for name in ("histogram", "reconstruct", "simplify", "add_threshold")},
    **{f"bpy.ops.ctmc.{name}": "SURFACE" for name in ("drain_add", "solid_reset")},
    **{"ctmc.goal": "SURFACE", "ctmc.ratio": "SURFACE", "bpy.ops.ctmc.quad_view": "DRAW"},
    **{
        f"bpy.ops.ctmc.{name}": "RESULTS"
        for name in ("pick_component", "export", "remove_small", "map_show", "cut_away")
    },
    **{f"bpy.ops.ctmc.{name}": "RENDER" for name in ("rotation_test", "rotation_save", "render")},
    **{"ctmc.rotation_kind": "RENDER", "ctmc_figure.kind": "RENDER"},
}
FIELDS = 0.65  # of the sidebar's width, where most fields and buttons are


def read_screen(file: Path) -> Image.Image:
    """The screen that the X server keeps in a file in the format of xwd, whose header is big-endian."""
    content = file.read_bytes()
    header = struct.unpack(">20I", content[:80])
    size, (width, height), line, colors = header[0], header[4:6], header[12], header[19]
    return Image.frombuffer("RGB", (width, height), content[size + 12 * colors :], "raw", "BGRX", line, 1)


class Desk:
    """One Blender, from installing the zip to quitting.

    Parameters
    ----------
    root : Path
        A Debian with Blender.
    pictures : Path
        Folder outside it for the screenshots.
    size : (width, height)
        Of the window, pixels.
    limit : float
        Seconds that an answer may take.
    """

    def __init__(
        self, root: Path, pictures: Path, size: tuple[int, int] = (WIDTH, HEIGHT), limit: float = LIMIT
    ) -> None:
        self.root, self.pictures, self.size, self.limit = root, pictures, size, limit
        self.folder = Path(tempfile.mkdtemp(prefix=DESKS, dir=root / "tmp"))
        self.inside = f"/tmp/{self.folder.name}"
        pictures.mkdir(parents=True, exist_ok=True)
        self.log = self.folder / "blender.log"
        self.log_start = 0
        self.questions = 0
        # Page, look and height at which a button was, a while ago perhaps.
        self.seen: dict[str, tuple[str, int, int]] = {}
        self.places: dict[str, int] = {}  # where it was as the sidebar is scrolled now
        self.row: int | None = None
        self.turned = 0  # looks that the sidebar is scrolled down
        self.display, self.server, self.mouse, self.blender = "", None, None, None

    # Inside the folder ------------------------------------------------------------------------------------------

    def command(self, *words: str) -> list[str]:
        """A command line inside the folder."""
        variables = [
            f"HOME={self.inside}",
            f"TMPDIR={self.inside}",
            f"XDG_RUNTIME_DIR={self.inside}",
            f"BLENDER_USER_RESOURCES={self.inside}/profile",
            f"DISPLAY={self.display}",
            "LIBGL_ALWAYS_SOFTWARE=1",
            "MESA_SHADER_CACHE_DIR=/var/cache/ctmc-shaders",
            "LC_ALL=C.UTF-8",
            "PATH=/usr/local/bin:/usr/bin:/bin",
        ]
        # Killed when the tests are, so that no window is left behind.
        return ["chroot", str(self.root), "setpriv", "--pdeathsig", "KILL", "env", "-i", *variables, *words]

    def call(self, *words: str) -> str:
        """Run a command inside the folder; what it printed."""
        done = subprocess.run(self.command(*words), capture_output=True, text=True, timeout=LIMIT, check=False)
        assert done.returncode == 0, f"{' '.join(words)}: status {done.returncode}\n{done.stdout}\n{done.stderr}"
        return done.stdout

    def bring(self, source: Path) -> str:
        """Copy a file or a folder in; its path there."""
        (shutil.copytree if source.is_dir() else shutil.copyfile)(source, self.folder / source.name)
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
        for old in (*self.folder.glob("ask-*.py"), *self.folder.glob("answer-*.json")):  # of a Blender that was killed
            old.unlink()
        self.questions, self.log_start = 0, 0
        self.places.clear()
        self.row, self.turned = None, 0
        width, height = self.size
        screen = [
            "-screen",
            "0",
            f"{width}x{height}x24",
            "+extension",
            "GLX",
            "-nolisten",
            "tcp",
            "-fbdir",
            self.inside,
        ]
        self.server = subprocess.Popen(
            self.command("Xvfb", "-displayfd", "1", *screen),
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        assert self.server.stdout is not None
        self.display = f":{self.server.stdout.readline().strip()}"
        assert self.display != ":", "the X server did not start"
        self.mouse = subprocess.Popen(
            self.command("stdbuf", "-oL", "xdotool", "-"), stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        window = ["--window-geometry", "0", "0", str(width), str(height), "-setaudio", "None"]
        with self.log.open("w") as log:
            self.blender = subprocess.Popen(
                self.command("blender", *window, "-P", self.bring(DRIVER), "--", self.inside),
                stdout=log,
                stderr=subprocess.STDOUT,
            )
        self.ask("answer = True")

    def is_open(self) -> bool:
        """Whether Blender is running."""
        return self.blender is not None and self.blender.poll() is None

    def reset(self) -> None:
        """Go back to Blender's first scene and preferences, whatever has been done."""
        for _ in range(3):  # menus, file browsers, modal operators
            self.key("Escape")
        self.first_scene()
        self.places.clear()
        self.row, self.turned = None, 0
        self.log_start = self.log.stat().st_size

    def first_scene(self) -> None:
        """Load Blender's first scene.

        A material that goes while its shader is compiled or its preview drawn takes Blender with it.
        """
        self.wait("not any(map(bpy.app.is_job_running, ('RENDER_PREVIEW', 'SHADER_COMPILATION')))")
        self.ask("reset()")

    def close(self) -> int | None:
        """Quit Blender and clean up; Blender's exit status, None where it never started."""
        try:
            if self.is_open():
                self.tell("bpy.ops.wm.quit_blender()")
                self.blender.wait(LIMIT)
        finally:
            self.kill()
            if self.folder.exists():
                if self.log.exists():
                    shutil.copyfile(self.log, self.pictures / "blender.log")
                shutil.rmtree(self.folder)
        return None if self.blender is None else self.blender.returncode

    def kill(self) -> None:
        """End Blender at once, as a crash does, and its window; `open` begins anew in the same folder."""
        for process in (self.blender, self.mouse, self.server):
            if process is not None and process.poll() is None:
                process.kill()
                process.wait()
        for pipe in (
            getattr(p, end) for p in (self.mouse, self.server) if p is not None for end in ("stdin", "stdout")
        ):
            if pipe is not None:
                pipe.close()

    # Questions --------------------------------------------------------------------------------------------------

    def tell(self, source: str) -> Path:
        """Hand Blender a few lines of Python; where the answer will be."""
        part = self.folder / "ask.part"
        part.write_text(source, encoding="utf-8")
        part.rename(self.folder / f"ask-{self.questions}.py")
        self.questions += 1
        return self.folder / f"answer-{self.questions - 1}.json"

    def ask(self, source: str) -> Any:
        """Run a few lines of Python in Blender, after all that was done before; what they leave in `answer`."""
        reply_file = self.tell(source)
        end = time.monotonic() + self.limit
        while not reply_file.exists():
            assert self.blender is None or self.blender.poll() is None, f"Blender has ended:\n{self.last_words()}"
            assert time.monotonic() < end, f"Blender did not answer within {self.limit:g} s:\n{source}"
            time.sleep(LOOK_AGAIN)
        reply = json.loads(reply_file.read_text(encoding="utf-8"))
        assert "error" not in reply, reply["error"]
        return reply["answer"]

    def wait(self, expression: str) -> Any:
        """Wait until a Python expression is true in Blender; its value."""
        end = time.monotonic() + self.limit
        while not (value := self.ask(f"answer = {expression}")):
            assert time.monotonic() < end, f"not within {self.limit:g} s: {expression}"
        return value

    def printed(self) -> str:
        """What Blender has printed since the last reset."""
        return self.log.read_bytes()[self.log_start :].decode("utf-8", "replace")

    def last_words(self) -> str:
        """The end of what Blender printed, and where it crashed."""
        crash = self.folder / "blender.crash.txt"
        return self.printed()[-3000:] + (crash.read_text(errors="replace")[-6000:] if crash.exists() else "")

    # Eye --------------------------------------------------------------------------------------------------------

    def look(self, name: str) -> Image.Image:
        """A picture of the whole screen as it is now, kept as `name`.png."""
        self.ask("redraw()")
        self.ask("answer = 'drawn'")
        picture = read_screen(self.folder / "Xvfb_screen0")
        picture.save(self.pictures / f"{name}.png", compress_level=1)
        return picture

    def find(self, button: str, at: float = FIELDS) -> tuple[int, int]:
        """Where a button of the tab is, with the mouse on it: a property's path or an operator's call.

        Blender says what is under the mouse. It looks where the button was, then beside what was found before it, then
        goes over the sidebar at this share of its width: the button's own page if another is shown, the page that is
        shown, the one on which the button was last, with the wheel too, all others; then each of them with the wheel.
        """
        x, top, height = self.across(at)
        for y in (self.places.get(button), self.row):
            if y is not None and self.under(x, y) == button:
                self.row = y
                return x, y
        shown = self.ask("answer = bpy.context.window_manager.ctmc_page")
        own = PAGE_OF.get(button.partition("(")[0], shown)
        page, turned, near = self.seen.get(button, (own, 0, None) if own != shown else (shown, self.turned, None))
        looks = [(shown, self.turned), (page, turned)] if own == shown else [(page, turned)]
        looks += [(page, further) for further in range(LOOKS) if button in self.seen or own != shown]
        looks += [(each, 0) for each in (shown, *PAGES)]
        looks += [(each, further) for each in (shown, *PAGES) for further in range(1, LOOKS)]
        for look in dict.fromkeys(looks):
            if look[0] != shown:
                shown = look[0]
                self.show(shown)
            if look[1] != self.turned:
                self.scroll(look[1])
            x, top, height = self.across(at)
            lines = list(range(top + height, top, -SCAN))
            if near is not None:
                lines.sort(key=lambda y: abs(y - near))
            names = self.ask(f"answer = rows({x}, {lines}, {button!r})")
            self.seen.update((name, (*look, y)) for name, y in zip(names, lines, strict=False))
            if names[-1] == button:
                break
        else:
            self.look("not-found")
            raise AssertionError(f"{button} is not in the sidebar; there is: {', '.join(sorted(self.seen))}")
        y = self.seen[button][-1]
        while self.under(x, y - SCAN) == button:
            y -= SCAN
        assert self.under(x, y) == button, f"{button} has moved"
        self.places[button] = self.row = y
        return x, y

    def across(self, at: float) -> tuple[int, int, int]:
        """A place across the sidebar at this share of its width, the sidebar's top and its height."""
        left, top, width, height = self.sidebar()
        return left + round(at * width), top, height

    def show(self, page: str) -> None:
        """Show a page of the tab, as a script does."""
        self.ask(f"show_page({page!r})")
        self.places.clear()
        self.row = None

    def sidebar(self) -> list[int]:
        """Left, top, width and height of the sidebar on the screen."""
        box: list[int] = self.ask("""
view = viewport()
bar = view.sidebar
answer = [bar.x, view.window.height - bar.y - bar.height, bar.width, bar.height]
""")
        return box

    def scroll(self, looks: int) -> None:
        """Turn the wheel over the sidebar to its top, and so many looks down."""
        left, top, _, height = self.sidebar()
        self.turn_wheel(left + 12, top + height // 2, up=True, clicks=NOTCHES * LOOKS)
        if looks:
            self.turn_wheel(left + 12, top + height // 2, up=False, clicks=NOTCHES * looks)
        self.turned = looks
        self.places.clear()

    def under(self, x: int, y: int) -> str:
        """Move the mouse, and what the sidebar has under it."""
        self.hand("mousemove", str(x - 2), str(y), "mousemove", str(x), str(y))
        return str(self.ask("answer = under_mouse()"))

    # Hand -------------------------------------------------------------------------------------------------------

    def hand(self, *words: str) -> None:
        """One xdotool command line; the last question makes it wait until the X server has done it."""
        assert self.mouse is not None
        self.mouse.stdin.write(" ".join([*words, "getmouselocation"]) + "\n")
        self.mouse.stdin.flush()
        assert self.mouse.stdout.readline().startswith("x:"), f"xdotool has ended at {' '.join(words)}"

    def move(self, x: int, y: int) -> None:
        """Move the mouse; Blender has seen it there."""
        self.hand("mousemove", str(x), str(y))
        self.ask("answer = 'moved'")

    def turn_wheel(self, x: int, y: int, *, up: bool, clicks: int) -> None:
        """Turn the wheel with the mouse at a place."""
        self.move(x, y)
        self.hand("click", "--repeat", str(clicks), "--delay", "1", "4" if up else "5")
        self.ask("answer = 'turned'")

    def press(self, button: str, operator: str, at: float = FIELDS) -> None:
        """Click on a button of an operator that can be pressed."""
        assert self.ask(f"answer = bpy.ops.ctmc.{operator}.poll()"), f"{button} is grayed out"
        self.find(button, at)
        self.click()

    def click(self, *place: int) -> None:
        """Click with the left button, at a place or where the mouse is."""
        if place:
            self.move(*place)
        for action in ("mousedown", "mouseup"):
            self.hand(action, "1")
            self.ask("answer = 'pressed'")

    def drag(self, start: tuple[int, int], end: tuple[int, int]) -> None:
        """Drag with the left button, in steps, as a hand does: Blender reads events that come together as one jump."""
        self.move(start[0] - 2, start[1])
        self.move(*start)
        self.hand("mousedown", "1")
        for step in range(DRAG_STEPS + 1):
            x, y = (round(a + (b - a) * step / DRAG_STEPS) for a, b in zip(start, end, strict=True))
            self.move(x, y)
        self.hand("mouseup", "1")
        self.ask("answer = 'let go'")

    def write(self, text: str) -> None:
        """Type a text, where the mouse is."""
        self.call("xdotool", "type", "--delay", "10", "--", text)
        self.ask("answer = 'written'")

    def key(self, keys: str) -> None:
        """Press a key or several together, where the mouse is."""
        self.hand("key", keys)
        self.ask("answer = 'pressed'")
