#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""cairn-eval reloc as a user runs it: on a rendered desk, and where something is missing.

reloc_test.py BIN_DIR [TestClass[.test]]   Standard library only.
"""
import os
import pathlib
import shutil
import subprocess
import sys
import unittest

import programs_test
from programs_test import LIMIT, OnTheDesk, command

FAILED, USAGE, CONFIGURATION = 1, 2, 3


class Reloc(OnTheDesk):
    FRAMES = 120

    def reloc(self, *words, expect, program=None, **environment):
        """What it says: (stdout, stderr)."""
        left = {name: value for name, value in os.environ.items() if name != "CAIRN_DATA"}
        words = command(program or "cairn-eval", "reloc", *words)
        done = subprocess.run(words, capture_output=True, text=True, timeout=LIMIT, env={**left, **environment})
        self.assertEqual(done.returncode, expect, done.stderr)
        return done.stdout, done.stderr

    def list_of(self, *rows):
        file = self.folder / "places.txt"
        file.write_text("\n".join(rows) + "\n")
        return file

    def test_a_recording_is_mapped_and_found_and_one_that_is_missing_is_named_to_the_end(self):
        places = self.list_of("video desk - groundtruth.txt m 90", "unmapped hall -")
        table, said = self.reloc("--places", places, "--ours", expect=FAILED, CAIRN_DATA=str(self.folder))
        self.assertIn("hall is left out: " + str(self.folder / "hall") + ": no such folder", said)
        last = said.splitlines()[-1]
        self.assertTrue(last.startswith("cairn-eval reloc: left out: hall; "), last)
        self.assertIn("--places FILE", last)
        asked, right = next(row for row in table.splitlines() if row.startswith("desk ")).split("|")[1].split()[:2]
        self.assertGreater(int(asked), 10)
        self.assertGreaterEqual(int(right), 0.9 * int(asked), table)
        methods = {row.split()[0] for row in table.splitlines() if "as recorded  " in row}
        self.assertEqual(methods, {"ours"})
        # Its folder of recordings is a word as well.
        self.reloc(self.folder, "--places", self.list_of("video desk - groundtruth.txt m 90"), "--ours", expect=0)

    def test_the_list_that_is_built_is_found(self):
        said = self.reloc(self.folder, expect=CONFIGURATION)[1]
        self.assertIn("sim-xyz is left out", said)
        self.assertIn("share/cairn/places.txt lists is in " + str(self.folder), said.splitlines()[-1])

    def test_what_is_wrong_is_said(self):
        self.assertIn("DATA_DIR is required", self.reloc(expect=USAGE)[1])
        self.assertIn("no such folder of recordings", self.reloc(self.folder / "nowhere", expect=CONFIGURATION)[1])
        missing = self.folder / "missing.txt"
        self.assertIn("missing.txt: no such file", self.reloc(self.folder, "--places", missing, expect=CONFIGURATION)[1])
        wrong = self.list_of("vidoe desk - - - 4")
        self.assertIn("places.txt:1: no kind of place is 'vidoe'", self.reloc(self.folder, "--places", wrong, expect=CONFIGURATION)[1])
        self.assertIn("--ourz", self.reloc(self.folder, "--ourz", expect=USAGE)[1])

    def test_helps(self):
        told = self.reloc("--help", expect=0)[0]
        for word in ("cairn-eval reloc", "DATA_DIR", "CAIRN_DATA", "--places", "--ours", "FOLDER CAMERA TRUTH UNIT FRAMES"):
            self.assertIn(word, told)
        told = subprocess.run(command("cairn-eval", "--help"), check=True, capture_output=True, text=True).stdout
        self.assertIn("reloc", told)

    def test_where_only_the_client_is_installed_it_says_what_to_build(self):
        alone = self.folder / "alone" / "cairn-eval"
        alone.parent.mkdir()
        shutil.copy(command("cairn-eval")[0], alone)
        said = self.reloc(self.folder, expect=CONFIGURATION, program=alone)[1]
        self.assertIn(str(alone.with_name("cairn-places-run")) + ": No such file or directory; ", said)
        self.assertIn("deploy/build release -DBUILD_TESTING=ON", said)


if __name__ == "__main__":
    programs_test.BINARIES = pathlib.Path(sys.argv.pop(1)).resolve()
    unittest.main(verbosity=2)
