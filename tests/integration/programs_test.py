#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""cairn-server and cairn-track as a user runs them, on a rendered desk with exact truth.

programs_test.py BIN_DIR [TestClass[.test]]   Standard library only.
"""
import contextlib
import json
import os
import pathlib
import re
import shutil
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
import unittest
import zlib

BINARIES = None
SLOWNESS = int(os.environ.get("CAIRN_TEST_SLOWNESS", "1"))  # of the build: recordings are played so much slower in real time
LIMIT = 300 * SLOWNESS  # seconds, which only a broken program takes
FIRST_DOMAIN = 215
DOMAINS = 10  # ports above those that the kernel gives out
NOBODYS_DOMAIN = FIRST_DOMAIN + DOMAINS - 1  # CTest's resource domain_224: no other test has a server there meanwhile
DAMAGED = 6


def command(program, *arguments):
    return [str(BINARIES / program), *map(str, arguments)]


def claim(domain):
    """What keeps other tests off a domain as long as it is open; None: another test has it."""
    claimed = socket.socket(socket.AF_UNIX)
    try:
        claimed.bind(f"\0cairn-test-domain-{domain}")
    except OSError:
        claimed.close()
        return None
    return claimed


class ServerProcess:
    """In the first domain that is free. It stays this test's while the server is down: another's would answer its clients."""

    def __init__(self, *arguments):
        self.arguments = arguments
        self.said = "others have all domains"
        for domain in range(FIRST_DOMAIN, FIRST_DOMAIN + DOMAINS):
            self.domain = domain
            self.claim = claim(domain)
            if self.claim is None:
                continue
            if self.start():
                return
            self.claim.close()
        raise RuntimeError("no server starts: " + self.said)

    def start(self):
        """Whether it is ready. What it says later is read as well: a full pipe would hold it up."""
        self.process = subprocess.Popen(command("cairn-server", "--domain", self.domain, *self.arguments),
                                        stderr=subprocess.PIPE, text=True)
        self.said = ""
        for line in self.process.stderr:
            self.said += line
            if ": ready on" in line:
                self.reader = threading.Thread(target=self.process.stderr.read, daemon=True)
                self.reader.start()
                return True
        self.process.wait()
        self.process.stderr.close()
        return False

    def kill_and_restart(self, pause):
        """As a crash, and somebody who starts it again after a while. Its socket may linger for a moment."""
        self.process.kill()
        self.process.wait()
        self.reader.join()
        self.process.stderr.close()
        time.sleep(pause)
        deadline = time.monotonic() + LIMIT
        while not self.start():
            if time.monotonic() > deadline:
                raise RuntimeError("the server does not come back: " + self.said)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.send_signal(signal.SIGCONT)
        self.process.terminate()
        self.process.wait(timeout=LIMIT)
        self.reader.join(timeout=LIMIT)
        self.process.stderr.close()
        self.claim.close()


@contextlib.contextmanager
def full_pipe():
    """The end to write to, of a pipe that nobody reads."""
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    with contextlib.suppress(BlockingIOError):
        while True:
            os.write(writer, bytes(4096))
    os.set_blocking(writer, True)
    try:
        yield writer
    finally:
        os.close(reader)
        os.close(writer)


def await_blocked(process, wanted):
    """Until it hears the signal as a question."""
    deadline = time.monotonic() + LIMIT
    while time.monotonic() < deadline and process.poll() is None:
        status = pathlib.Path(f"/proc/{process.pid}/status").read_text()
        if int(re.search(r"SigBlk:\s*(\w+)", status)[1], 16) >> (wanted - 1) & 1:
            return
        time.sleep(0.01)
    raise RuntimeError(f"{process.args[0]} does not block {wanted.name}")


def slow_down(recording):
    """The stamps of a rendered sequence, for programs that were built to be checked and not to be fast."""
    for name in ("rgb.txt", "groundtruth.txt", "labels.txt"):
        rows = [row.split(maxsplit=1) for row in (recording / name).read_text().splitlines()]
        (recording / name).write_text("".join(
            f"{stamp} {rest}\n" if stamp.startswith("#") else f"{float(stamp) * SLOWNESS:.6f} {rest}\n"
            for stamp, rest in rows))


class OnTheDesk(unittest.TestCase):
    FRAMES = 240

    @classmethod
    def setUpClass(cls):
        cls.scratch = tempfile.TemporaryDirectory()
        cls.folder = pathlib.Path(cls.scratch.name)
        cls.render("desk", 1)

    @classmethod
    def render(cls, folder, seed):
        subprocess.run(command("cairn-sim", "render", "desk", "--out", cls.folder / folder, "--frames", cls.FRAMES,
                               "--seed", seed),
                       check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        slow_down(cls.folder / folder)

    @classmethod
    def tearDownClass(cls):
        cls.scratch.cleanup()

    def arguments(self, server, name, *more, recording="desk"):
        return command("cairn-track", "--source", f"tum:{self.folder}/{recording}", "--domain", server.domain, "--name", name,
                       "--headless", "--trajectory", self.folder / f"{name}.txt", "--stats", self.folder / f"{name}.json",
                       *more)

    def track(self, server, name, *more, code=0, **of_source):
        done = subprocess.run(self.arguments(server, name, *more, **of_source), stderr=subprocess.PIPE, text=True, timeout=LIMIT)
        self.assertEqual(done.returncode, code, done.stderr)
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
        self.assertRegex(said, r"camera: pinhole with radial-tangential distortion, 640x480, f ")
        self.other_truths_say_the_same("first")

    def other_truths_say_the_same(self, name):
        """EuRoC's rows and rows without a pose change nothing; a quaternion with w first is suspected."""
        rows = [row.split() for row in (self.folder / "desk/groundtruth.txt").read_text().splitlines() if row[0] != "#"]
        w_first = [[*row[:4], row[7], *row[4:7]] for row in rows]
        seconds = "".join(" ".join(row) + "\n" for row in w_first)
        euroc = "#timestamp [ns],p_RS_R_x [m],...\n" + "".join(f"{round(float(row[0]) * 1e6) * 1000},{','.join(row[1:])}\n" for row in w_first)
        for text, note, same in ((seconds, "quaternions probably have w first", False), (euroc, "poses of the body", True),
                                 (euroc + "9" * 18 + ",nan" * 7, "1 row with NaN", True)):
            truth = self.folder / "truth.csv"
            truth.write_text(text)
            done = subprocess.run(command("cairn-eval", "rpe", truth, self.folder / f"{name}.txt", "--json"), check=True,
                                  capture_output=True, text=True)
            said = json.loads(done.stdout)
            self.assertIn(note, "".join(said["notes"]))
            self.assertIn(note, done.stderr)
            self.assertEqual(said["rotation_deg"]["rmse"] < 0.5, same)


class Labels(OnTheDesk):
    def labels(self, server):
        done = subprocess.run(command("cairnctl", "--domain", server.domain, "--json", "labels"), capture_output=True, text=True,
                              timeout=LIMIT, check=True)
        return json.loads(done.stdout)

    def test_labels_are_placed_where_the_recording_says_and_kept_and_change_no_pose(self):
        with ServerProcess() as server:
            self.track(server, "builder", "--pace", "lockstep")
        plain = (self.folder / "builder.txt").read_bytes()
        store = self.folder / "labels"
        with ServerProcess("--store", store) as server:
            _, said = self.track(server, "builder", "--pace", "lockstep", "--labels", self.folder / "desk/labels.txt")
            placed = self.labels(server)
        self.assertIn("label 'desk' placed", said)
        self.assertIn("labels placed: 1 of 1", said)
        self.assertEqual([(label["text"], label["author"]) for label in placed], [("desk", "builder")])
        self.assertEqual((self.folder / "builder.txt").read_bytes(), plain)
        with ServerProcess("--store", store) as server:
            self.assertEqual([(label["text"], label["map"]) for label in self.labels(server)], [("desk", placed[0]["map"])])

    def test_what_could_not_be_placed_is_said(self):
        late = self.folder / "late.txt"
        late.write_text("0 320 240 too early\n1000 320 240 too late\n")
        with ServerProcess() as server:
            _, said = self.track(server, "hasty", "--pace", "lockstep", "--labels", late)
            self.assertEqual(self.labels(server), [])
        self.assertIn("frame 0: label 'too early' not placed: no map here", said)
        self.assertIn("label 'too late' not placed: its time did not come", said)
        self.assertIn("labels placed: 0 of 2", said)

    def test_a_file_that_makes_no_sense_ends_the_program_before_a_server_is_asked(self):
        wrong = self.folder / "wrong.txt"
        wrong.write_text("1 700 240 outside\n")
        done = subprocess.run(command("cairn-track", "--source", f"tum:{self.folder}/desk", "--headless", "--labels", wrong),
                              stderr=subprocess.PIPE, text=True, timeout=LIMIT)
        self.assertEqual(done.returncode, DAMAGED, done.stderr)
        self.assertIn(f"{wrong}:1: the pixel lies outside the image, which is 640x480", done.stderr)


class Cameras(OnTheDesk):
    FRAMES = 400  # until three more keyframes agree

    def test_a_camera_of_which_nothing_is_known_is_calibrated_written_and_kept_with_the_map(self):
        saved = self.folder / "found.yaml"
        store = self.folder / "store"
        truth = next(line.split() for line in (self.folder / "desk/camera.txt").read_text().splitlines()
                     if line and not line.startswith("#"))
        with ServerProcess("--store", store) as server:
            stats, said = self.track(server, "auto", "--calibration", "auto", "--save-calibration", saved, "--pace", "lockstep")
        self.assertIn("the camera is known", said)
        self.assertIn(str(saved), said)
        found = re.search(r"intrinsics: *\[([^\]]*)\]", saved.read_text())
        focal = float(found.group(1).split(",")[0])
        self.assertLess(abs(focal / float(truth[2]) - 1), 0.03, said)
        kept = saved.read_bytes()
        with ServerProcess("--store", store) as server:
            stats, said = self.track(server, "again", "--calibration", saved, "--role", "reader", "--pace", "lockstep")
            self.assertEqual(self.map_row("again"), self.map_row("auto"))
            self.assertGreaterEqual(stats["summary"]["tracked_share"], 0.95, said)
            path, row = (self.folder / "auto.txt").read_bytes(), self.map_row("auto")
            stats, said = self.track(server, "auto", "--calibration", "auto", "--save-calibration", saved, "--pace", "lockstep")
        self.assertEqual(self.map_row("auto"), row, "the map knows the camera of that name, which begins with a guess again")
        self.assertGreaterEqual(stats["summary"]["tracked_share"], 0.95, said)
        self.assertIn("the camera is known", said)
        with ServerProcess() as server:
            self.track(server, "auto", "--calibration", "auto", "--save-calibration", saved, "--pace", "lockstep")
        self.assertEqual((self.folder / "auto.txt").read_bytes(), path, "a run is repeated to the byte")
        self.assertEqual(saved.read_bytes(), kept)

    def test_a_calibration_without_distortion_is_refined_unless_it_is_called_exact(self):
        plain = self.folder / "plain.txt"
        truth = next(line.split() for line in (self.folder / "desk/camera.txt").read_text().splitlines()
                     if line and not line.startswith("#"))
        plain.write_text(" ".join(truth[:6]) + "\n")
        errors = {}
        for name, words in (("nominal", [plain]), ("exact", [f"exact:{plain}"])):
            with ServerProcess() as server:
                stats, said = self.track(server, name, "--calibration", *words, "--pace", "lockstep")
            self.assertGreaterEqual(stats["summary"]["tracked_share"], 0.95, said)
            self.assertEqual("the calibration has no distortion" in said, name == "nominal", said)
            errors[name] = self.ate_mm(name)
        self.assertLess(errors["nominal"], errors["exact"], "the lens does distort")

    def test_a_camera_that_is_not_known_in_the_end_is_said_to_be_so_and_not_written(self):
        brief = self.folder / "brief"
        brief.mkdir()
        (brief / "rgb").symlink_to(self.folder / "desk/rgb")
        rows = (self.folder / "desk/rgb.txt").read_text().splitlines(keepends=True)
        (brief / "rgb.txt").write_text("".join(rows[:60]))  # and no camera.txt
        saved = self.folder / "unknown.yaml"
        with ServerProcess() as server:
            stats, said = self.track(server, "brief", "--save-calibration", saved, "--pace", "lockstep", recording="brief", code=1)
        self.assertIsNotNone(stats["first_map_frame"], said)
        self.assertIn("the camera is calibrated while the map grows", said)
        self.assertIn("the camera is not known well enough, none was written: focal length", said)
        self.assertFalse(saved.exists())


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


def black_png(width, height):
    """A gray image that shows nothing."""
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    rows = (b"\0" + bytes([8]) * width) * height
    return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)) +
            chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))


class Places(OnTheDesk):
    """Recordings put together from two desks and a covered camera."""
    COVERED = 10

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.render("other", 2)
        cls.write_recording("other-builder", [("other", range(cls.FRAMES))])

    @classmethod
    def write_recording(cls, name, parts):
        """`parts`: (desk, frame numbers); between two of them the camera is covered. Stamps run on at 30 Hz / SLOWNESS."""
        folder = cls.folder / name
        folder.mkdir()
        (folder / "camera.txt").write_text((cls.folder / "desk/camera.txt").read_text())
        (folder / "black.png").write_bytes(black_png(640, 480))
        images = []
        for desk, frames in parts:
            if images:
                images += ["black.png"] * cls.COVERED
            listed = [row.split()[1] for row in (cls.folder / desk / "rgb.txt").read_text().splitlines() if row[0] != "#"]
            images += [f"../{desk}/{listed[i]}" for i in frames]
        (folder / "rgb.txt").write_text("".join(f"{i * SLOWNESS / 30:.6f} {image}\n" for i, image in enumerate(images)))

    def play(self, server, name, recording, *more):
        done = subprocess.run(command("cairn-track", "--source", f"tum:{self.folder}/{recording}", "--domain", server.domain,
                                      "--name", name, "--headless", "--trajectory", self.folder / f"{name}.txt", "--stats",
                                      self.folder / f"{name}.json", *more),
                              stderr=subprocess.PIPE, text=True, timeout=LIMIT)
        self.assertEqual(done.returncode, 0, done.stderr)
        return json.loads((self.folder / f"{name}.json").read_text())["frames"], done.stderr

    IN_LOCKSTEP = 10  # frames to be back in, three of which are the proof
    IN_REAL_TIME = 45  # any that leave some of the 60 to look at: frames are time there, and the machine may be slow

    def assert_back_soon(self, frames, first, said, patience=IN_LOCKSTEP):
        """Tracked again when something is seen again, not before it is proven, and from then on."""
        tracked = [frame["state"] in ("tracking", "poor") for frame in frames]
        self.assertFalse(any(tracked[first - self.COVERED + 1:first]), "a covered camera has no pose")
        self.assertFalse(any(tracked[first:first + 2]), "not before it is proven")
        back = next(i for i in range(first, len(tracked)) if tracked[i])
        self.assertLessEqual(back - first, patience, said)
        seen = [frame for frame in frames[back:first + 60] if frame["state"] != "dropped"][:10]
        self.assertGreater(sum(frame["state"] in ("tracking", "poor") for frame in seen), 0.8 * len(seen), said)

    def test_a_tracker_shown_another_part_of_its_map_after_a_loss_finds_itself(self):
        self.write_recording("elsewhere", [("desk", range(60)), ("desk", range(180, 240)), ("desk", range(40, 100))])
        for pace, patience in (("lockstep", self.IN_LOCKSTEP), ("realtime", self.IN_REAL_TIME)):
            with ServerProcess() as server:
                self.track(server, f"maker-{pace}", "--pace", "lockstep")
                name = f"jumper-{pace}"
                frames, said = self.play(server, name, "elsewhere", "--role", "reader", "--pace", pace)
                self.assert_back_soon(frames, 70, said, patience)
                self.assert_back_soon(frames, 140, said, patience)
                self.assertEqual(len([row for row in (self.folder / f"{name}.txt").read_text().splitlines()
                                      if row.startswith("# map")]), 1)

    def test_a_tracker_carried_between_two_maps_switches(self):
        with ServerProcess() as server:
            self.track(server, "maker", "--pace", "lockstep")
            self.play(server, "other-maker", "other-builder", "--pace", "lockstep")
            self.write_recording("walk", [("desk", range(60)), ("other", range(60, 120)), ("desk", range(100, 160))])
            for pace, patience in (("lockstep", self.IN_LOCKSTEP), ("realtime", self.IN_REAL_TIME)):
                name = f"walker-{pace}"
                frames, said = self.play(server, name, "walk", "--role", "reader", "--pace", pace)
                self.assert_back_soon(frames, 70, said, patience)
                self.assert_back_soon(frames, 140, said, patience)
                maps = [row.split()[3] for row in (self.folder / f"{name}.txt").read_text().splitlines()
                        if row.startswith("# map")]
                self.assertEqual(maps, ["map-1", "map-2", "map-1"])

    def test_a_builder_in_an_unmapped_place_begins_a_map_and_goes_on_in_one_that_is_known(self):
        self.write_recording("round", [("desk", range(120)), ("other", range(240)), ("desk", range(40, 100))])
        with ServerProcess() as server:
            frames, said = self.play(server, "rounder", "round", "--pace", "lockstep", "--lost-patience", 1)
            maps = [row.split()[3] for row in (self.folder / "rounder.txt").read_text().splitlines()
                    if row.startswith("# map")]
            self.assertEqual(maps, ["map-1", "map-2", "map-1"], said)
            self.assert_back_soon(frames, 120 + 10 + 240 + 10, said)


class Wearers(OnTheDesk):
    """Two maps of one desk, so that the question where a camera is has two right answers."""
    FRAMES = 360

    def ctl(self, server, *words):
        done = subprocess.run(command("cairnctl", "--domain", server.domain, "--json", *words), capture_output=True, text=True,
                              timeout=LIMIT)
        self.assertEqual(done.returncode, 0, done.stderr)
        return json.loads(done.stdout)

    def test_the_map_of_a_wearers_other_camera_is_the_answer(self):
        with ServerProcess("--store", self.folder / "store") as server:
            for name in ("old", "new"):
                self.track(server, f"maker-of-{name}", "--pace", "lockstep")
                self.ctl(server, "map", "map-1", "rename", name)
                self.ctl(server, "map", name, "delete")
            for where in ("old", "new"):  # one of them would be the answer without the rule
                self.assertEqual(self.where_the_hand_is(server, where), [where])

    def where_the_hand_is(self, server, where):
        """The names of the maps that the hand camera is in, while the one at the shoulder is tracked in `where`, where it was
        before there was the other map."""
        other = "new" if where == "old" else "old"
        worn = ("--role", "reader", "--wearer", "anna")
        self.ctl(server, "map", where, "undelete")
        shoulder = subprocess.Popen(self.arguments(server, f"shoulder-{where}", "--pace", "realtime", *worn),
                                    stderr=subprocess.PIPE, text=True)
        said = ""
        for line in shoulder.stderr:
            said += line
            if f"map {where} " in line and "entered" in line:
                break
        self.ctl(server, "map", other, "undelete")
        name = f"hand-{where}"
        hand = subprocess.Popen(self.arguments(server, name, "--pace", "lockstep", *worn), stderr=subprocess.PIPE, text=True)
        hand_said = hand.communicate(timeout=LIMIT)[1]
        said += shoulder.communicate(timeout=LIMIT)[1]
        self.assertEqual((shoulder.returncode, hand.returncode), (0, 0), said + hand_said)
        self.assertIn("entered", said)
        for name_of_map in ("old", "new"):
            self.ctl(server, "map", name_of_map, "delete")
        return [row.split()[3] for row in (self.folder / f"{name}.txt").read_text().splitlines() if row.startswith("# map")]


class Faults(OnTheDesk):
    FRAMES = 450

    def test_a_recording_that_is_interrupted_is_a_shorter_one_and_leaves_no_images_of_an_earlier_one(self):
        folder = self.folder / "short"
        for stop in (signal.SIGTERM, signal.SIGINT):
            render = subprocess.Popen(command("cairn-sim", "render", "desk", "--out", folder), stdout=subprocess.PIPE,
                                      stderr=subprocess.PIPE, text=True)
            self.assertIn("frame 30 of 1800", render.stderr.readline())
            render.send_signal(stop)
            printed, said = render.communicate(timeout=LIMIT)
            self.assertEqual((render.returncode, printed), (130, ""))
            frames = len((folder / "rgb.txt").read_text().splitlines()) - 1
            self.assertIn(f"interrupted: {folder} has {frames} of 1800 frames", said)
            self.assertEqual(len((folder / "groundtruth.txt").read_text().splitlines()) - 1, frames)
            self.assertEqual(len(list((folder / "rgb").iterdir())), frames)
        subprocess.run(command("cairn-sim", "render", "desk", "--out", folder, "--frames", 3), check=True,
                       stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        self.assertEqual(len(list((folder / "rgb").iterdir())), 3)

    def test_a_focal_length_that_is_none_is_refused_before_a_server_is_asked(self):
        wrong = self.folder / "wrong.txt"
        wrong.write_text("640 480 50 50 320 240 0 0 0 0\n")
        done = subprocess.run(command("cairn-track", "--source", f"tum:{self.folder}/desk", "--calibration", wrong, "--headless"),
                              stderr=subprocess.PIPE, text=True, timeout=LIMIT)
        self.assertEqual(done.returncode, 3, done.stderr)
        self.assertIn(f"{wrong}: focal lengths 50 and 50 px for an image of 640x480", done.stderr)

    def test_without_a_server_what_an_earlier_run_left_is_kept(self):
        kept = {self.folder / f"kept.{end}": f"of an earlier run: {end}" for end in ("txt", "json", "mp4")}
        for path, text in kept.items():
            path.write_text(text)
        done = subprocess.run(command("cairn-track", "--source", f"tum:{self.folder}/desk", "--domain", NOBODYS_DOMAIN, "--headless",
                                      "--pace", "lockstep", "--trajectory", self.folder / "kept.txt",
                                      "--stats", self.folder / "kept.json", "--video", self.folder / "kept.mp4"),
                              stderr=subprocess.PIPE, text=True, timeout=LIMIT)
        self.assertEqual(done.returncode, 4, done.stderr)
        stopped = subprocess.Popen(done.args, stderr=subprocess.PIPE, text=True)
        for line in stopped.stderr:
            if "waiting for cairn-server" in line:
                break
        stopped.send_signal(signal.SIGINT)
        self.assertEqual((stopped.communicate(timeout=LIMIT), stopped.returncode)[1], 130)
        for path, text in kept.items():
            self.assertEqual(path.read_text(), text)

    def test_outputs_that_nobody_reads_cost_no_frame_and_no_signal(self):
        """A trajectory into a pipe without a reader, statistics into one whose reader hangs, a log into a full one."""
        for name in ("hung.txt", "hung.json"):
            os.mkfifo(self.folder / name)
        reader = os.open(self.folder / "hung.json", os.O_RDONLY | os.O_NONBLOCK)
        with ServerProcess("-q") as server, full_pipe() as log:
            run = subprocess.run(self.arguments(server, "hung", "--pace", "max"), stderr=log, timeout=LIMIT)
            self.assertEqual(run.returncode, 3)
            run = subprocess.Popen(self.arguments(server, "hung", "--pace", "realtime"), stderr=log)
            await_blocked(run, signal.SIGTERM)
            run.send_signal(signal.SIGTERM)
            self.assertIn(run.wait(timeout=LIMIT), (3, 130))
            with open("/dev/full", "w") as full:
                self.assertEqual(subprocess.call(command("cairnctl", "--domain", server.domain, "status"), stdout=full), 3)
        os.close(reader)

    def test_a_full_disk_is_said_by_name_at_once_and_at_the_end(self):
        for end in ("txt", "json"):
            (self.folder / f"full.{end}").symlink_to("/dev/full")
        with ServerProcess("-q") as server:
            done = subprocess.run(self.arguments(server, "full", "--pace", "max"), stderr=subprocess.PIPE, text=True, timeout=LIMIT)
        self.assertEqual(done.returncode, 3, done.stderr)
        full = r": cannot be written: No space left on device"
        self.assertRegex(done.stderr, rf"full\.txt{full}; going on")
        self.assertRegex(done.stderr, rf"full\.txt{full}; \d+ of \d+ rows are missing")
        self.assertRegex(done.stderr, rf"full\.json{full}; not complete")

    def test_a_signal_leaves_whole_files(self):
        rows = self.folder / "cut.txt"
        with ServerProcess("-q") as server:
            run = subprocess.Popen(self.arguments(server, "cut", "--pace", "realtime", "--video", self.folder / "cut.mkv"),
                                   stderr=subprocess.PIPE, text=True)
            deadline = time.monotonic() + LIMIT
            while time.monotonic() < deadline and run.poll() is None and not (rows.exists() and rows.read_text().count("\n") > 30):
                time.sleep(0.01)
            run.send_signal(signal.SIGTERM)
            said = run.communicate(timeout=LIMIT)[1]
        self.assertEqual(run.returncode, 130, said)  # the video was read to its end, or it would be 3
        self.assertTrue(rows.read_text().endswith("\n"))
        poses = [row for row in rows.read_text().splitlines() if not row.startswith("#")]
        self.assertTrue(all(len(row.split()) == 8 for row in poses))
        self.assertEqual(json.loads((self.folder / "cut.json").read_text())["tracked"], len(poses))

    def test_a_server_whose_log_nobody_reads_hears_a_signal(self):
        with full_pipe() as log:
            server = subprocess.Popen(command("cairn-server", "--domain", NOBODYS_DOMAIN), stderr=log)
            await_blocked(server, signal.SIGTERM)
            server.send_signal(signal.SIGTERM)
            self.assertEqual(server.wait(timeout=LIMIT), 0)

    def test_a_run_without_a_map_says_so_last_and_is_no_success_where_a_trajectory_was_asked_for(self):
        with ServerProcess("-q") as server:
            _, said = self.track(server, "mapless", "--role", "reader", "--pace", "max", code=1)
            self.assertIn("ends without a map", said.splitlines()[-1])
            done = subprocess.run(command("cairn-track", "--source", f"tum:{self.folder}/desk", "--domain", server.domain, "--headless",
                                          "--role", "reader", "--pace", "max"), stderr=subprocess.PIPE, text=True, timeout=LIMIT)
            self.assertEqual(done.returncode, 0, done.stderr)
            self.assertIn("ends without a map", done.stderr.splitlines()[-1])

    def test_lockstep_at_a_server_that_refuses_it_ends_with_the_remedy(self):
        with ServerProcess("--lockstep", "refuse") as server:
            _, said = self.track(server, "refused", "--pace", "lockstep", code=5)
            self.assertIn("--lockstep allow", said.splitlines()[-1])

    def test_a_recording_that_is_mostly_damaged_is_no_success(self):
        damaged = self.folder / "damaged"
        (damaged / "rgb").mkdir(parents=True)
        shutil.copy(self.folder / "desk/camera.txt", damaged)
        rows = (self.folder / "desk/rgb.txt").read_text().splitlines(keepends=True)[:41]
        (damaged / "rgb.txt").write_text("".join(rows))
        for i, name in enumerate(row.split()[1] for row in rows if not row.startswith("#")):
            image = (self.folder / "desk" / name).read_bytes()
            (damaged / name).write_bytes(image if i < 15 else image[:100])
        with ServerProcess() as server:
            stats, said = self.track(server, "damaged", "--pace", "lockstep", recording="damaged", code=6)
        self.assertIn("25 of 40 frames could not be decoded", said)
        self.assertEqual(stats["frames_total"], 40)


class Crashes(OnTheDesk):
    """A server that hangs or is killed. The frames are played in real time, and those that were tracked are counted."""
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
            self.assert_never_stands_still(frames)

    def assert_never_stands_still(self, frames):
        """Whatever the server does: a frame loop that waited for it would drop what came meanwhile, all in a row."""
        longest = run = 0
        for frame in frames:
            run = run + 1 if frame["state"] == "dropped" else 0
            longest = max(longest, run)
        self.assertLess(longest, 60, "two seconds without a frame")

    def play_through_a_crash(self, name, server):
        """The server is killed (-9) when the map has grown a little and started again 3 s later; figures of the frames after
        the map, and what was said."""
        tracker = subprocess.Popen(self.arguments(server, name, "--pace", "realtime", "--lost-patience", 30),
                                   stderr=subprocess.PIPE, text=True)
        said = ""
        for line in tracker.stderr:
            said += line
            if said.count("accepted") >= 4:
                break
        server.kill_and_restart(3)
        said += tracker.communicate(timeout=LIMIT)[1]
        self.assertEqual(tracker.returncode, 0, said)
        frames = json.loads((self.folder / f"{name}.json").read_text())["frames"]
        first = next(i for i, frame in enumerate(frames) if frame["state"] in ("tracking", "poor"))
        return frames[first:], said

    def assert_tracked_through(self, frames, said):
        """Tracked, or turned away from what the replica shows, in all but 5 % of the frames that were not
        dropped, until another map is begun, when the replica no longer shows what the camera sees."""
        states = [frame["state"] for frame in frames]
        if "starting" in states:
            states = states[:states.index("starting")]
        self.assertGreater(len(states), 120, "the map was there before the crash")
        taken = [state for state in states if state != "dropped"]
        self.assertGreaterEqual(sum(state in ("tracking", "poor", "rotation") for state in taken),
                                0.95 * len(taken), said)
        self.assertGreaterEqual(sum(state in ("tracking", "poor") for state in taken), 0.85 * len(taken), said)
        self.assert_never_stands_still(frames)
        self.assertIn("server gone: tracking on the replica", said)

    def test_a_server_that_is_killed_and_comes_back_with_its_maps(self):
        with ServerProcess("--store", self.folder / "store") as server:
            frames, said = self.play_through_a_crash("kept", server)
            self.assert_tracked_through(frames, said)
            self.assertNotIn("restarted without this map", said)
            self.assertEqual((self.folder / "kept.txt").read_text().count("# map"), 1)

    def test_a_server_that_is_killed_and_comes_back_with_nothing(self):
        with ServerProcess() as server:
            frames, said = self.play_through_a_crash("bereft", server)
            self.assert_tracked_through(frames, said)
            self.assertIn("restarted without this map", said)
            self.assertIn(frames[-1]["state"], ("tracking", "poor"), said)


if __name__ == "__main__":
    BINARIES = pathlib.Path(sys.argv.pop(1))
    unittest.main(verbosity=2)
