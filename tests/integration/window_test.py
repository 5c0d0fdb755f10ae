#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The window of cairn-track as a person uses it, on a display of its own (Xvfb), with keys and clicks by xdotool.

window_test.py BIN_DIR [TestClass[.test]]   Standard library only; skipped where these two are not installed.
"""
import json
import pathlib
import shutil
import subprocess
import sys
import tempfile
import threading
import time
import unittest

import programs_test
from programs_test import LIMIT, OnTheDesk, ServerProcess, command
from screen import Screen, is_there

SLOWER = 16  # the recording is played, so that it lasts longer than what is done to the window
TITLE = "cairn-track viewer"


class Viewer:
    def __init__(self, screen, arguments):
        self.screen = screen
        self.process = subprocess.Popen(arguments, env=screen.environment, stderr=subprocess.PIPE, text=True)
        self.said = ""
        self.reader = threading.Thread(target=self.listen, daemon=True)
        self.reader.start()

    def listen(self):
        for line in self.process.stderr:
            self.said += line

    def window(self):
        return self.screen.do("search", "--name", f"^{TITLE}$").split()

    def press(self, *keys):
        self.screen.do("windowfocus", "--sync", self.window()[0])
        for key in keys:
            self.screen.do("key", "--delay", 100, key)

    def click(self, x, y):
        self.screen.do("mousemove", "--window", self.window()[0], x, y, "click", 1)

    def close(self):
        self.process.kill()
        self.process.wait()
        self.reader.join()
        self.process.stderr.close()


@unittest.skipUnless(is_there(), "apt-get install xvfb xdotool")
class Window(OnTheDesk):
    def setUp(self):
        self.server = ServerProcess()
        self.addCleanup(self.server.__exit__)
        self.screen = Screen()
        self.addCleanup(self.screen.close)
        self.track(self.server, "builder", "--pace", "lockstep")
        self.slow = self.folder / "slow"
        shutil.copytree(self.folder / "desk", self.slow)
        rows = (line.split(maxsplit=1) for line in (self.slow / "rgb.txt").read_text().splitlines() if line[0] != "#")
        (self.slow / "rgb.txt").write_text("".join(f"{float(stamp) * SLOWER:.6f} {rest}\n" for stamp, rest in rows))

    def labels(self):
        said = subprocess.run(command("cairnctl", "--domain", self.server.domain, "--json", "labels"), check=True,
                              capture_output=True, text=True, timeout=LIMIT).stdout
        return [(label["text"], label["author"]) for label in json.loads(said)]

    def wait_for(self, what, seconds=LIMIT):
        deadline = time.monotonic() + seconds
        while not what():
            if time.monotonic() > deadline:
                return False
            time.sleep(0.05)
        return True

    def test_keys_and_clicks_do_what_they_are_for_and_no_more(self):
        stats = self.folder / "viewer.json"
        viewer = Viewer(self.screen, command("cairn-track", "--source", f"tum:{self.slow}", "--domain", self.server.domain,
                                             "--name", "viewer", "--no-new-maps", "--pace", "realtime", "--stats", stats))
        self.addCleanup(viewer.close)
        self.assertTrue(self.wait_for(viewer.window), viewer.said)
        self.assertTrue(self.wait_for(lambda: "map-1" in viewer.said), viewer.said)
        viewer.press("p", "x", "Return", "h", "Escape", "f")
        self.assertEqual(self.labels(), [], "no place was pointed at")
        placed = False
        for x, y in ((320, 240), (220, 180), (420, 300), (320, 140), (320, 340)):  # some may have no points
            viewer.click(x, y)
            viewer.press("h", "i", "Return")
            if placed := self.wait_for(self.labels, 5):
                break
            viewer.press("Escape")
        self.assertTrue(placed, viewer.said)
        viewer.press("f", "p")
        self.assertEqual(self.labels(), [("hi", "viewer")])
        self.assertIsNone(viewer.process.poll(), viewer.said)
        viewer.press("q")
        self.assertEqual(viewer.process.wait(timeout=LIMIT), 0, viewer.said)
        viewer.reader.join()
        self.assertNotIn("window is lost", viewer.said)
        self.assertLess(json.loads(stats.read_text())["frames_total"], self.FRAMES, "it did not end by itself")
        self.assertEqual(self.labels(), [("hi", "viewer")])


@unittest.skipUnless(is_there(), "apt-get install xvfb xdotool")
class Images(unittest.TestCase):
    """Two trackers of one wearer on this host: the window of the one shows what the other sees."""

    def setUp(self):
        scratch = tempfile.TemporaryDirectory()
        self.addCleanup(scratch.cleanup)
        self.folder = pathlib.Path(scratch.name)
        self.heard = {}
        self.server = ServerProcess()
        self.addCleanup(self.server.__exit__)
        self.screen = Screen()
        self.addCleanup(self.screen.close)

    def open(self, name, *more):
        arguments = command("cairn-track", "--source", "sim:desk?frames=9000", "--domain", self.server.domain, "--name", name,
                            "--role", "reader", "--wearer", "ada", "--stats", self.folder / f"{name}.json", *more)
        tracker = Viewer(self.screen, arguments)
        self.addCleanup(tracker.close)
        return tracker

    def hears(self, tracker, words, seconds):
        """Whether it says so, after what it was heard to say before."""
        deadline = time.monotonic() + seconds
        while (place := tracker.said.find(words, self.heard.get(tracker, 0))) < 0:
            if time.monotonic() > deadline:
                return False
            time.sleep(0.02)
        self.heard[tracker] = place + len(words)
        return True

    def wait_for(self, *what):
        for tracker, words in what:
            self.assertTrue(self.hears(tracker, words, LIMIT), f"{words} is missing in:\n{tracker.said}")

    def show_the_other(self, viewer):
        deadline = time.monotonic() + LIMIT
        while not viewer.window():
            self.assertLess(time.monotonic(), deadline, viewer.said)
            time.sleep(0.05)
        viewer.press("o")
        while not self.hears(viewer, "camera shoulder of wearer ada", 3):  # the window had not heard of it yet
            self.assertLess(time.monotonic(), deadline, viewer.said)
            viewer.press("o")

    def test_images_come_while_they_are_asked_for_and_who_dies_is_missed(self):
        shoulder = self.open("shoulder", "--headless")
        self.wait_for((shoulder, "client 'shoulder'"))
        viewer = self.open("viewer")
        begin = time.monotonic()
        self.show_the_other(viewer)
        self.wait_for((viewer, "shows its images"), (shoulder, "images of this camera go to viewer"))
        time.sleep(1)
        viewer.press("o")
        self.wait_for((shoulder, "nobody asks for images of this camera any more; "))
        self.assert_sent(shoulder, time.monotonic() - begin)

        begin = time.monotonic()
        self.show_the_other(viewer)
        self.wait_for((shoulder, "images of this camera go to viewer"))
        viewer.process.kill()
        self.wait_for((shoulder, "nobody asks for images of this camera any more; "))
        self.assert_sent(shoulder, time.monotonic() - begin)
        viewer.process.wait()

        viewer = self.open("viewer")
        self.show_the_other(viewer)
        self.wait_for((viewer, "shows its images"))
        shoulder.process.kill()
        self.wait_for((viewer, "has given no image for a second"), (viewer, "is not there"))
        viewer.press("q")
        self.assertEqual(viewer.process.wait(timeout=LIMIT), 0, viewer.said)
        images = json.loads((self.folder / "viewer.json").read_text())["pictures"]
        self.assertGreater(images["received"], 0)
        self.assertEqual((images["sent"], images["cpu_ms"]), (0, 0), "nobody asked for the viewer's")

    def assert_sent(self, tracker, seconds):
        sent = int(tracker.said[self.heard[tracker]:].split()[0])
        self.assertGreater(sent, 0)
        self.assertLessEqual(sent, 10 * seconds + 2, "ten a second at most")


if __name__ == "__main__":
    programs_test.BINARIES = pathlib.Path(sys.argv.pop(1)).resolve()
    unittest.main(verbosity=2)
