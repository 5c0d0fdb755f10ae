#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The paper's experiments, one seed of each in lockstep (tests/bench/run-experiment).

experiments_test.py BIN_DIR [Experiments.test_NAME]   Standard library only.
"""
import json
import pathlib
import subprocess
import sys
import tempfile
import unittest

BINARIES = None
RUN_EXPERIMENT = pathlib.Path(__file__).resolve().parents[1] / "bench" / "run-experiment"
PASSED = 0
BOTH_METHODS = ("improved", "paper")

# Where a label appears may be off by what somebody means who points there (the found point within 2 % of the image's width, 1.5
# degrees of these cameras) and by what the pose is off. Of five labels the worst alone is the p95 of their frames.
MOST_DEGREES_P95, MOST_DEGREES = 2.0, 2.5


class Experiments(unittest.TestCase):
    def play(self, name, places, domain, methods=("improved",)):
        """Our method: all places are mapped, labelled and found, and no camera was told to be at another place than it is. A place that
        is held for half a second after the camera has left it is no complaint, and a figure (tests/bench/FIGURES.md). Of the paper's
        method run-experiment itself asks that it has its troubles. Gives our verdict."""
        with tempfile.TemporaryDirectory() as folder:
            told = pathlib.Path(folder) / "verdict.json"
            command = [RUN_EXPERIMENT, name, "--build", BINARIES.parent, "--domain", str(domain), "--json", told]
            done = subprocess.run([*command, *(word for method in methods for word in ("--method", method))],
                                  stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
            self.assertEqual(done.returncode, PASSED, done.stdout)
            print(done.stdout)
            verdict, *others = json.loads(told.read_text())
        self.assertEqual([verdict["method"], *(other["method"] for other in others)], list(methods))
        self.assertEqual(verdict["complaints"], [])
        self.assertEqual((verdict["to_map"], verdict["mapped"]), (places, places))
        self.check_labels(verdict, places)
        return verdict

    def check_labels(self, verdict, places):
        self.assertEqual([label["placed"] for label in verdict["labels"]], [True] * places)
        for label in verdict["labels"]:
            self.assertGreater(label["degrees"]["frames"], 0, f"{label['place']} was never looked at")
        off = verdict["labels_degrees"]
        self.assertLessEqual(off["p95"], MOST_DEGREES_P95, verdict["labels"])
        self.assertLessEqual(off["max"], MOST_DEGREES, verdict["labels"])

    def test_desk(self):
        self.assertEqual(self.play("desk", 12, 225)["found"], 12)

    def test_building(self):
        self.assertEqual(self.play("building", 5, 227, BOTH_METHODS)["found"], 5)

    def test_laboratory(self):
        robot, = (place for place in self.play("laboratory", 2, 228)["places"] if place["name"] == "robot")
        # One visit may be tracked in the room's map, rightly: whichever is held stays until lost, as in the paper.
        found = [visit["frames_to_lock"] is not None for visit in robot["visits"]]
        self.assertGreaterEqual(found.count(True), len(found) - 1, robot)


if __name__ == "__main__":
    BINARIES = pathlib.Path(sys.argv.pop(1)).resolve()
    unittest.main()
