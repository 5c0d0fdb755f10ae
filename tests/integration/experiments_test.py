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
PASSED, NOT_PASSED = 0, 1


class Experiments(unittest.TestCase):
    def play(self, name, domain):
        """Its verdict. No camera was told to be at another place than it is; a place that is held for some frames after the camera
        has left it is no such lock, and a figure (tests/bench/README.md)."""
        with tempfile.TemporaryDirectory() as folder:
            told = pathlib.Path(folder) / "verdict.json"
            done = subprocess.run([RUN_EXPERIMENT, name, "--build", BINARIES.parent, "--domain", str(domain), "--json", told],
                                  stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
            self.assertIn(done.returncode, (PASSED, NOT_PASSED), done.stdout)
            print(done.stdout)
            verdict, = json.loads(told.read_text())
        self.assertEqual([lock for lock in verdict["wrong_locks"] if not lock["held"]], [])
        self.assertEqual(verdict["mapped"], verdict["to_map"])
        return verdict

    def test_desk(self):
        self.assertEqual(self.play("desk", 225)["found"], 12)

    def test_building(self):
        self.assertEqual(self.play("building", 227)["found"], 5)

    def test_laboratory(self):
        for place in self.play("laboratory", 228)["places"]:
            # At every visit would be too much: whichever map is held stays until lost, as in the paper.
            self.assertTrue(any(visit["right"] for visit in place["visits"]), place)


if __name__ == "__main__":
    BINARIES = pathlib.Path(sys.argv.pop(1)).resolve()
    unittest.main()
