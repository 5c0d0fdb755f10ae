#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""cairn-server and cairn-track as a user runs them, on a rendered desk with exact truth.

programs_test.py BIN_DIR [TestClass[.test]]   Standard library only.
"""
import json
import pathlib
import signal
import subprocess
import sys
import tempfile
import time
import unittest

BINARIES = None
LIMIT = 300  # seconds, which only a broken program takes
FIRST_DOMAIN = 215
DOMAINS = 10  # ports above those that the kernel gives out


def command(program, *arguments):
    return [str(BINARIES / program), *map(str, arguments)]


class ServerProcess:
    """In the first domain that is free."""

    def __init__(self):
        for domain in range(FIRST_DOMAIN, FIRST_DOMAIN + DOMAINS):
            self.domain = domain
            self.process = subprocess.Popen(command("cairn-server", "--domain", domain), stderr=subprocess.PIPE, text=True)
            said = ""
            for line in self.process.stderr:
                said += line
                if "ready" in line:
                    return
            self.process.wait()
        raise RuntimeError("no server starts: " + said)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.send_signal(signal.SIGCONT)
        self.process.terminate()
        self.process.communicate(timeout=LIMIT)


class OnTheDesk(unittest.TestCase):
    FRAMES = 240

    @classmethod
    def setUpClass(cls):
        cls.scratch = tempfile.TemporaryDirectory()
        cls.folder = pathlib.Path(cls.scratch.name)
        subprocess.run(command("cairn-sim", "render", "desk", "--out", cls.folder / "desk", "--frames", cls.FRAMES,
                               "--seed", 1),
                       check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    @classmethod
    def tearDownClass(cls):
        cls.scratch.cleanup()

    def arguments(self, server, name, *more):
        return command("cairn-track", "--source", f"tum:{self.folder}/desk", "--domain", server.domain, "--name", name,
                       "--headless", "--trajectory", self.folder / f"{name}.txt", "--stats", self.folder / f"{name}.json",
                       *more)

    def track(self, server, name, *more):
        done = subprocess.run(self.arguments(server, name, *more), stderr=subprocess.PIPE, text=True, timeout=LIMIT)
        self.assertEqual(done.returncode, 0, done.stderr)
        return json.loads((self.folder / f"{name}.json").read_text()), done.stderr

    def ate_mm(self, name):
        done = subprocess.run(command("cairn-eval", "ate", self.folder / "desk/groundtruth.txt", self.folder / f"{name}.txt",
                                      "--json"), check=True, capture_output=True, text=True)
        return 1000 * json.loads(done.stdout)["rmse"]

    def map_row(self, name):
        return next(row for row in (self.folder / f"{name}.txt").read_text().splitlines() if row.startswith("# map"))


class Lockstep(OnTheDesk):
    def test_two_runs_are_equal_to_the_byte_and_good(self):
        for name in ("first", "second"):
            with ServerProcess() as server:  # each a fresh one, without a seed
                stats, said = self.track(server, name, "--pace", "lockstep", "--seed", 3)
            self.assertGreaterEqual(stats["summary"]["tracked_share"], 0.95, said)
            self.assertLessEqual(self.ate_mm(name), 5)
        self.assertEqual((self.folder / "first.txt").read_bytes(), (self.folder / "second.txt").read_bytes())


class Followers(OnTheDesk):
    def test_a_reader_and_one_without_new_maps_track_in_anothers_map(self):
        with ServerProcess() as server:
            self.track(server, "builder", "--pace", "lockstep")
            for name, right in (("reader", ["--role", "reader"]), ("helper", ["--no-new-maps"]),
                                ("chooser", ["--role", "reader", "--map", "map-1"])):
                stats, said = self.track(server, name, "--pace", "lockstep", *right)
                self.assertGreaterEqual(stats["summary"]["tracked_share"], 0.9, said)
                self.assertEqual(self.map_row(name), self.map_row("builder"))
                self.assertLessEqual(self.ate_mm(name), 5)


class Faults(OnTheDesk):
    FRAMES = 450

    def test_a_server_that_hangs_for_five_seconds_while_the_map_starts(self):
        with ServerProcess() as server:
            tracker = subprocess.Popen(self.arguments(server, "late", "--pace", "realtime", "--lost-patience", 3),
                                       stderr=subprocess.PIPE, text=True)
            said = ""
            for line in tracker.stderr:
                said += line
                if "frame 0" in line:
                    break
            server.process.send_signal(signal.SIGSTOP)
            time.sleep(5)
            server.process.send_signal(signal.SIGCONT)
            said += tracker.communicate(timeout=LIMIT)[1]
            self.assertEqual(tracker.returncode, 0, said)
            frames = json.loads((self.folder / "late.json").read_text())["frames"]
            tracked = [i for i, frame in enumerate(frames) if frame["state"] in ("tracking", "poor")]
            self.assertTrue(tracked, said)


if __name__ == "__main__":
    BINARIES = pathlib.Path(sys.argv.pop(1))
    unittest.main(verbosity=2)
