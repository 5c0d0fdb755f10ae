#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Keyframes of readers, kept aside and accepted, with the programs as people run them: the sun, or books and a mug, have moved since a
desk was mapped.

proposals_test.py BIN_DIR [TestClass[.test]]   Standard library only.
"""
import json
import pathlib
import re
import struct
import subprocess
import sys
import tempfile
import unittest

import programs_test
from programs_test import LIMIT, ServerProcess, command

OK, USAGE, REFUSED = 0, 2, 5
DESK = "sim:desk?seed=1&frames="
LATER = "sim:desk?seed=1&light=later&frames="
MOVED = "sim:desk-moved?seed=1&frames="
AT_WHAT_MOVED = slice(185, 250)  # frames of that route that look at the books from near by


def size_and_colours(png):
    """Width, height, colour type (2: red, green and blue)."""
    data = png.read_bytes()
    return struct.unpack(">II", data[16:24]) + (data[25],)


class Proposals(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        self.server = ServerProcess("--store", self.folder / "store")
        self.addCleanup(self.server.__exit__)

    def track(self, name, source, *words):
        """What it says, and its statistics."""
        stats = self.folder / f"{name}.json"
        done = subprocess.run(command("cairn-track", "--source", source, "--domain", self.server.domain, "--name", name, "--headless",
                                      "--pace", "lockstep", "--stats", stats, *words), stderr=subprocess.PIPE, text=True, timeout=LIMIT)
        self.assertEqual(done.returncode, OK, done.stderr)
        return done.stderr, json.loads(stats.read_text())

    def ctl(self, *words, expect=OK):
        done = subprocess.run(command("cairnctl", "--domain", self.server.domain, "--json", *words), capture_output=True, text=True,
                              timeout=LIMIT)
        self.assertEqual(done.returncode, expect, done.stderr)
        return json.loads(done.stdout) if expect == OK else done.stderr

    def keyframes(self):
        return self.ctl("map", "map-1", "show")["keyframes"]

    def test_a_map_stays_fresh_when_the_light_has_changed(self):
        self.track("builder", DESK + "150")
        before = self.keyframes()

        said, _ = self.track("visitor", LATER + "250", "--role", "reader")
        self.assertNotIn("proposal", said)
        self.assertEqual(self.ctl("proposals"), [], "they are off")

        self.ctl("proposals", "on", "map-1")
        self.assertEqual(self.ctl("rights")["proposals_in"][0]["name"], "map-1")
        said, _ = self.track("shy", LATER + "250", "--role", "reader", "--no-proposals")
        self.assertEqual(self.ctl("proposals"), [], "its user does not want to")

        said, saw = self.track("visitor", LATER + "250", "--role", "reader")
        self.assertIn("this map takes proposals", said)
        self.assertIn("keyframe kept aside as a proposal: its tracker only reads (--role reader)", said)
        self.ctl("rights", "grant", "phone", "map-1", "read")
        said, _ = self.track("phone", LATER + "250")
        self.assertRegex(said, "kept aside as a proposal: phone may only read here|shows the same already")
        waiting = self.ctl("proposals", "map-1")
        self.assertEqual(self.keyframes(), before, "a proposal is no part of the map")
        for proposal in waiting:
            self.assertIn(proposal["client"], ("visitor", "phone"))
            self.assertTrue(20 <= proposal["found"] <= proposal["expected"], proposal)

        self.server.kill_and_restart(0)
        self.assertEqual(self.ctl("proposals"), waiting)
        first = waiting[0]["id"]
        image = self.folder / "seen.png"
        shown = self.ctl("proposals", "show", first, "--save", image)
        self.assertEqual(size_and_colours(image), (640, 480, 2))
        self.assertEqual(len(shown["points"]), shown["expected_now"])
        self.assertIn("is there already", self.ctl("proposals", "show", first, "--save", image, expect=USAGE))

        accepted = self.ctl("proposals", "accept", first)
        self.assertEqual((accepted[0]["id"], accepted[0]["client"]), (first, "visitor"))
        self.assertGreater(self.keyframes(), before)
        self.assertIn(f"no proposal {first}", self.ctl("proposals", "accept", first, expect=REFUSED))
        said, sees = self.track("other", LATER + "250", "--role", "reader", "--no-proposals")
        counts = [int(n) for n in re.findall(r"map of (\d+) keyframes", said)]
        self.assertGreater(counts[-1], before, "another client has the new keyframe")
        inliers = [sum(f["inliers"] for f in run["frames"]) for run in (saw, sees)]
        print(f"{before} keyframes, {len(waiting)} proposals, {self.keyframes()} keyframes; "
              f"points found in all frames: {inliers[0]} before, {inliers[1]} after")
        self.assertGreater(inliers[1], inliers[0], "in the new light more is found")

        self.assertIn("ID... or --all", self.ctl("proposals", "drop", expect=USAGE))
        self.ctl("proposals", "drop", "--all", expect=USAGE)  # nobody can be asked
        self.ctl("proposals", "drop", "--all", "--yes")
        self.assertEqual(self.ctl("proposals"), [])
        log = [(e["who"].split()[0], e["action"]) for e in self.ctl("audit")]
        self.assertIn(("operator", "proposal accept"), log)
        self.assertIn(("operator", "proposals welcome"), log)

    def test_a_map_stays_fresh_when_furniture_has_moved(self):
        self.track("builder", DESK + "185")
        self.ctl("proposals", "on", "map-1")
        before = self.keyframes()
        _, saw = self.track("visitor", MOVED + "300", "--role", "reader")
        for proposal in self.ctl("proposals", "map-1"):  # the map maker has the last word
            subprocess.run(command("cairnctl", "--domain", self.server.domain, "proposals", "accept", proposal["id"]), capture_output=True,
                           timeout=LIMIT)
        self.assertGreater(self.keyframes(), before)
        _, sees = self.track("other", MOVED + "300", "--role", "reader", "--no-proposals")
        near = [run["frames"][AT_WHAT_MOVED] for run in (saw, sees)]
        held = [sum(frame["state"] == "tracking" for frame in frames) for frames in near]
        inliers = [sum(frame["inliers"] for frame in frames) for frames in near]
        print(f"{before} keyframes, then {self.keyframes()}; beside what was moved, of {len(near[0])} frames {held[0]} are well tracked "
              f"before and {held[1]} after, with {inliers[0]} and {inliers[1]} points found")
        self.assertGreater(held[1], held[0], "where things were moved, more frames are well tracked")
        self.assertGreater(inliers[1], inliers[0], "and more is found")


if __name__ == "__main__":
    programs_test.BINARIES = pathlib.Path(sys.argv.pop(1)).resolve()
    unittest.main(verbosity=2)
