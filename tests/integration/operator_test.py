#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""cairnctl as an operator runs it, against a server that keeps its maps. COLMAP judges what is exported, where it is installed.

operator_test.py BIN_DIR [TestClass[.test]]   Standard library only.
"""
import contextlib
import json
import math
import os
import pathlib
import pwd
import re
import shutil
import signal
import sqlite3
import subprocess
import sys
import time
import unittest

import colmap_model
import programs_test
from programs_test import LIMIT, OnTheDesk, ServerProcess, command

OK, USAGE, CONFIGURATION, NO_SERVER, REFUSED, DAMAGED, INTERRUPTED = 0, 2, 3, 4, 5, 6, 130


def colour_type(png):
    return png.read_bytes()[25]


class Operator(OnTheDesk):
    FRAMES = 120

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.server = ServerProcess("--store", cls.folder / "store")
        cls.addClassCleanup(cls.server.__exit__)
        done = subprocess.run(command("cairn-track", "--source", f"tum:{cls.folder}/desk", "--domain", cls.server.domain,
                                      "--name", "builder", "--headless", "--pace", "lockstep"),
                              stderr=subprocess.PIPE, text=True, timeout=LIMIT)
        assert done.returncode == 0, done.stderr

    def ctl(self, *words, expect=OK, server=None):
        done = subprocess.run(command("cairnctl", "--domain", (server or self.server).domain, "--json", *words),
                              capture_output=True, text=True, timeout=LIMIT)
        self.assertEqual(done.returncode, expect, done.stderr)
        return json.loads(done.stdout) if expect == OK else done.stderr

    def say(self, *words, server=None):
        """As a person reads it."""
        return self.say_both(*words, server=server)[0]

    def say_both(self, *words, server=None):
        """What goes on to other programs, and what is talk."""
        done = subprocess.run(command("cairnctl", "--domain", (server or self.server).domain, *words), check=True,
                              capture_output=True, text=True, timeout=LIMIT)
        return done.stdout, done.stderr

    def names(self, server=None):
        return [m["name"] for m in self.ctl("maps", "list", server=server)["maps"]]

    def test_says_how_the_server_is(self):
        status = self.ctl("status")
        self.assertEqual(status["health"], "ok")
        self.assertEqual(status["store"], str(self.folder / "store"))
        self.assertEqual((status["limits"]["maps"], status["limits"]["rest_after_s"]), (1000, 60))
        self.assertGreater(status["limits"]["memory_bytes"], status["memory_bytes"])
        with ServerProcess("--max-maps", 3, "--max-memory", 20, "--idle-after", 7) as server:
            self.assertEqual(self.ctl("status", server=server)["limits"], {"maps": 3, "memory_bytes": 20_000_000, "rest_after_s": 0},
                             "what is kept nowhere else is not evicted")
            said = self.say("status", server=server)
            self.assertIn("maps     0 of 3 (--max-maps), 0 of them idle (--idle-after: never)", said)
            self.assertIn("memory   0.0 of 20.0 MB (--max-memory)", said)
            for what in ("maps", "labels"):
                self.assertEqual(self.say_both(what, server=server), ("", f"cairnctl: no {what}\n"))
        self.assertIn("usage", subprocess.run(command("cairnctl", "--help"), capture_output=True, text=True).stdout.lower())

    def test_exit_codes(self):
        self.assertIn("no map 'nowhere'", self.ctl("map", "nowhere", "show", expect=REFUSED))
        self.ctl("map", "map-1", "rename", "No Name", expect=USAGE)
        self.ctl("fly", expect=USAGE)
        self.assertEqual(self.ctl("labels", "map-1"), [])
        self.assertEqual(self.ctl("labels"), [])
        said = self.ctl("labels", "map-1", "remove", 7, "--yes", expect=REFUSED)
        self.assertIn("label 7 of map 'map-1'", said)
        self.assertIn("cairnctl labels map-1", said)
        self.assertIn("no map 'nowhere'; `cairnctl maps`", self.ctl("labels", "nowhere", expect=REFUSED))
        self.ctl("labels", "remove", 7, expect=USAGE)
        done = subprocess.run(command("cairn-track", "--source", f"tum:{self.folder}/desk", "--domain", self.server.domain, "--role",
                                      "reader", "--map", "nowhere", "--headless"), stderr=subprocess.PIPE, text=True, timeout=LIMIT)
        self.assertEqual(done.returncode, REFUSED, done.stderr)
        self.assertIn("lists no map 'nowhere'", done.stderr)
        unused = type("Nobody", (), {"domain": 229})
        self.assertIn("is cairn-server running", self.ctl("status", expect=NO_SERVER, server=unused))
        self.assertIn("`cairnctl keys issue`", self.ctl("--security", self.folder, "status", expect=CONFIGURATION))

    def test_lists_of_one_kind_of_thing_are_arrays(self):
        for words in (("labels",), ("labels", "list"), ("clients",), ("clients", "list"), ("wearers",), ("rigs",), ("proposals",),
                      ("proposals", "list"), ("audit",), ("map", "map-1", "tags"), ("map", "map-1", "contributors"), ("verify",)):
            self.assertIsInstance(self.ctl(*words), list, words)
        self.assertEqual(self.ctl("maps").keys(), {"maps", "deleted", "damaged", "unloaded"}, "of several kinds")

    def test_nothing_is_written_into_a_folder_that_is_not_there(self):
        nowhere = self.folder / "tpyo"
        for words in (("backup", nowhere / "monday.tar"), ("verify", "--backup", nowhere / "monday.tar"),
                      ("restore", nowhere / "monday.tar", "--data", nowhere / "store")):
            said = self.ctl(*words, expect=CONFIGURATION)
            self.assertIn(f"{nowhere}", said)
            self.assertFalse(nowhere.exists(), words)
        self.assertIn(f"`mkdir -p {nowhere}`", self.ctl("backup", nowhere / "monday.tar", expect=CONFIGURATION))

    def test_a_refusal_of_several_is_told_once(self):
        done = subprocess.run(command("cairnctl", "--domain", self.server.domain, "maps", "export", "attic", "cellar", "--out",
                                      self.folder / "none"), capture_output=True, text=True, timeout=LIMIT)
        self.assertEqual((done.stderr.count("'attic'"), done.stderr.count("'cellar'")), (1, 1), done.stderr)
        self.assertTrue(done.stderr.endswith("cairnctl: 0 of 2 maps exported\n"), done.stderr)
        said = self.ctl("proposals", "accept", "no-1", "no-2", expect=REFUSED)
        self.assertEqual((said.count("no proposal no-1"), said.count("no proposal no-2")), (1, 1), said)
        self.assertTrue(said.endswith("cairnctl: 2 of 2 proposals not accepted\n"), said)

    def test_a_command_shows_its_own_examples_only(self):
        told = subprocess.run(command("cairnctl", "rights", "explain", "--help"), check=True, capture_output=True, text=True).stdout
        self.assertEqual(re.findall(r"^  cairnctl .*$", told, re.M), ["  cairnctl rights explain phone-2 desk"])

    def test_a_run_that_drops_most_frames_says_so_last_and_is_no_success(self):
        done = subprocess.run(command("cairn-track", "--source", f"images:{self.folder}/desk/rgb?fps=20000", "--headless", "--role", "reader",
                                      "--domain", self.server.domain, "--trajectory", self.folder / "dropped.txt"),
                              stderr=subprocess.PIPE, text=True, timeout=LIMIT)
        self.assertEqual(done.returncode, 1, done.stderr)
        self.assertRegex(done.stderr.splitlines()[-1], rf"most frames were dropped, \d+ of {self.FRAMES}")

    def test_a_plot_that_nobody_reads_costs_no_end(self):
        pipe, truth = self.folder / "plot.png", self.folder / "desk/groundtruth.txt"
        os.mkfifo(pipe)
        done = subprocess.run(command("cairn-eval", "ate", truth, truth, "--plot", pipe), capture_output=True, text=True, timeout=LIMIT)
        self.assertEqual(done.returncode, CONFIGURATION, done.stderr)
        self.assertIn("nobody reads it", done.stderr)

    def test_texts_are_utf8_and_paths_are_bytes(self):
        """What is no text is named before the server hears of it; what a path is called costs no work that is done."""
        for words in (("map", "K\udcfcche", "show"), ("map", "map-1", "rename", "K\udcfcche"), ("maps", "purge", "K\udcfc"),
                      ("labels", "map-1", "rename", "1", "K\udcfcche"), ("labels", "map-1", "rename", "1", "a\u202eb"),
                      ("labels", "map-1", "rename", "1", "a\u009b2J"), ("labels", "map-1", "rename", "1", "de\u200bsk")):
            said = self.ctl(*words, expect=USAGE)
            self.assertRegex(said, r"no UTF-8|cannot be seen")
            self.assertTrue(said.replace("\n", "").isprintable(), said)
        self.assertIn("no map 'K\u00fcche'", self.ctl("map", "K\u00fcche", "show", expect=REFUSED))
        out = str(self.folder) + "/caf\udce9"
        shown = str(self.folder) + "/caf\\xe9/map-1.cairnmap"
        self.assertEqual(self.ctl("maps", "export", "--out", out), [f"file://{self.folder}/caf%E9/map-1.cairnmap"])
        self.assertEqual(self.say("maps", "export", "--out", out), shown + "\n")
        self.assertIn("caf\\xe9/no.cairnmap: cannot be read", self.ctl("maps", "import", out + "/no.cairnmap", expect=CONFIGURATION))
        self.assertIn("'Frage\\xfc'", self.ctl("Frage\udcfc", expect=USAGE))

    def test_an_archive_does_not_come_out_of_a_pipe(self):
        pipe = self.folder / "pipe.cairnmap"
        os.mkfifo(pipe)
        self.assertIn("not a regular file", self.ctl("maps", "import", pipe, expect=CONFIGURATION))

    def test_what_cannot_be_imported_is_named_once_and_what_it_is_not(self):
        junk, missing = self.folder / "no.cairnmap", self.folder / "missing.cairnmap"
        junk.write_text("this is no archive " * 500)
        shutil.copytree(self.folder / "store/maps", self.folder / "full/maps")
        with ServerProcess("--store", self.folder / "full", "--max-maps", 1) as full:
            self.assertIn(f"cairnctl: {junk}: not an archive of a map",
                          self.ctl("maps", "import", junk, expect=DAMAGED, server=full))
        self.assertEqual(self.ctl("maps", "import", missing, expect=CONFIGURATION),
                         f"cairnctl: {missing}: cannot be read: No such file or directory\n")
        with contextlib.closing(sqlite3.connect(self.folder / "other.cairnmap")) as other:
            other.execute("CREATE TABLE map(id INTEGER PRIMARY KEY)")
            other.commit()
        self.assertIn("not an archive", self.ctl("maps", "import", self.folder / "other.cairnmap", expect=DAMAGED))

    def test_shows_all_of_a_map(self):
        shown = self.ctl("map", "map-1", "show")
        (camera,) = shown["cameras"]
        self.assertEqual((camera["width"], camera["height"], camera["keyframes"]), (640, 480, shown["keyframes"]))
        self.assertEqual((camera["focal_px"], shown["labels"]), (502.3, 0))
        said = self.say("map", "map-1", "show")
        for words in (f"epoch         {shown['epoch']}, revision", "plane         ",
                      f"reprojection  {shown['reprojection_px']:.2f} px",
                      f"camera        640x480 {camera['model']}, focal length 502.3 px: {shown['keyframes']} keyframes",
                      "labels        0"):
            self.assertIn(words, said)
        self.assertNotIn("epoch", self.say("map", "map-1", "rename", "map-1"))

    def test_renames_deletes_and_undeletes_as_often_as_it_is_told(self):
        for _ in range(2):
            self.assertEqual(self.ctl("map", "map-1", "show")["name"], "map-1")
        shown = self.ctl("map", "map-1", "rename", "bench")
        self.assertEqual(shown["name"], "bench")
        self.assertEqual(self.names(), ["bench"])
        for _ in range(2):
            self.ctl("map", "bench", "delete")
            self.assertEqual(self.names(), [])
        self.assertEqual([m["name"] for m in self.ctl("maps")["deleted"]], ["bench"])
        for asked in (("map", "bench", "show"), ("map", "bench", "rename", "x"), ("labels", "bench"), ("maps", "export", "bench")):
            self.assertEqual(self.ctl(*asked, expect=REFUSED),
                             "cairnctl: map 'bench' is deleted; `cairnctl map bench undelete` puts it back into service\n")
        self.assertEqual(self.ctl("map", "attic", "show", expect=REFUSED), "cairnctl: no map 'attic'; `cairnctl maps` lists them\n")
        self.assertEqual(self.say("map", "bench", "delete"), "bench deleted; `cairnctl map bench undelete` puts it back\n")
        listed, talk = self.say_both("maps")
        self.assertRegex(listed, rf"^bench +{shown['id']}  deleted")
        self.assertEqual(talk, "", "there is a map, if only a deleted one")
        for _ in range(2):
            back = self.ctl("map", "bench", "undelete")
        self.assertEqual((back["keyframes"], back["points"]), (shown["keyframes"], shown["points"]))
        self.assertGreater(back["epoch"], shown["epoch"])
        self.assertEqual(self.ctl("map", shown["id"], "rename", "map-1")["name"], "map-1")

    def test_a_name_that_several_maps_had_is_not_guessed_at(self):
        with ServerProcess("--store", self.folder / "several") as server:
            ids = []
            for name in ("first", "second"):
                done = subprocess.run(command("cairn-track", "--source", f"tum:{self.folder}/desk", "--domain", server.domain,
                                              "--name", name, "--headless", "--pace", "realtime"),
                                      stderr=subprocess.PIPE, text=True, timeout=LIMIT)
                self.assertEqual(done.returncode, 0, done.stderr)
                ids.append(self.ctl("map", "map-1", "show", server=server)["id"])
                if name == "first":
                    self.ctl("map", "map-1", "delete", server=server)
            self.assertEqual(self.say("map", "map-1", "delete", server=server),
                             f"map-1 deleted; `cairnctl map {ids[1]} undelete` puts it back\n")
            self.assertEqual(self.ctl("map", ids[1], "undelete", server=server)["name"], "map-1")
            said = self.ctl("map", "map-1", "undelete", expect=REFUSED, server=server)  # one is in use, one deleted
            for name in ids:
                self.assertIn(name, said)
            self.assertEqual(self.ctl("map", ids[0], "undelete", server=server)["name"], "map-1-2")
            for name in ids:
                self.ctl("map", name, "delete", server=server)
            deleted = self.ctl("maps", server=server)["deleted"]
            self.assertEqual([m["id"] for m in deleted], [ids[1], ids[0]], "the latest first")
            self.assertTrue(all(m["bytes"] > 0 for m in deleted))
            self.assertEqual(self.say("maps", "purge", ids[1], "--yes", server=server), "map-1 removed for good\n")
            self.assertEqual([m["id"] for m in self.ctl("maps", server=server)["deleted"]], [ids[0]])
            self.assertEqual(list((self.folder / "several/transfer").iterdir()), [])

    def test_what_cannot_be_had_back_is_not_deleted_by_a_slip(self):
        with ServerProcess() as server:
            done = subprocess.run(command("cairn-track", "--source", f"tum:{self.folder}/desk", "--domain", server.domain,
                                          "--name", "builder", "--headless", "--pace", "lockstep"),
                                  stderr=subprocess.PIPE, text=True, timeout=LIMIT)
            self.assertEqual(done.returncode, 0, done.stderr)
            self.assertIn("--for-good", self.ctl("map", "map-1", "delete", expect=REFUSED, server=server))
            self.assertEqual(self.names(server), ["map-1"])
            self.assertIn("If it is meant, give the command with --yes", self.ctl("map", "map-1", "delete", "--for-good", expect=USAGE, server=server))
            self.assertEqual(self.names(server), ["map-1"])
            self.assertEqual(self.say("map", "map-1", "delete", "--for-good", "--yes", server=server), "map-1 removed for good\n")
            self.assertEqual(self.names(server), [])

    def test_limits_hold_for_maps_from_elsewhere_too(self):
        out = self.folder / "limits"
        self.ctl("maps", "export", "map-1", "--out", out)
        self.assertEqual(list((self.folder / "store/transfer").iterdir()), [], "nothing is left of an export")
        with ServerProcess("--store", self.folder / "small", "--max-memory", 1) as small:
            self.assertIn("--max-memory", self.ctl("maps", "import", out / "map-1.cairnmap", expect=REFUSED, server=small))
        (out / "map-1.cairnmap").unlink()
        (out / "map-1.cairnmap").mkdir()  # cannot be written
        said = self.ctl("maps", "export", "map-1", "--out", out, expect=CONFIGURATION)
        self.assertIn("map-1.cairnmap: cannot be written: Is a directory", said)
        self.assertEqual([p.name for p in out.iterdir()], ["map-1.cairnmap"], "nothing is left of what failed")

    def test_an_export_for_other_programs_leaves_the_archive_alone(self):
        out = self.folder / "kept"
        self.ctl("maps", "export", "--out", out)
        archive = (out / "map-1.cairnmap").read_bytes()
        self.ctl("maps", "export", "map-1", "--format", "ply", "--out", out)
        self.assertEqual((out / "map-1.cairnmap").read_bytes(), archive)
        (out / "map-1/sparse").mkdir()
        (out / "map-1/sparse/project.ini").write_text("the user's")
        said = self.ctl("maps", "export", "map-1", "--format", "colmap", "--out", out, expect=REFUSED)
        self.assertIn("project.ini", said)
        self.assertEqual((out / "map-1.cairnmap").read_bytes(), archive)
        self.assertEqual(sorted(p.name for p in out.iterdir()), ["map-1", "map-1.cairnmap"], "and nothing hidden")

    def server_with_the_map(self, name):
        """For what it is left with by exports that do not come to their end."""
        shutil.copytree(self.folder / "store/maps", self.folder / name / "maps")
        return ServerProcess("--store", self.folder / name)

    def test_a_full_disk_is_told_of_the_file_that_was_asked_for(self):
        out = self.folder / "full disk"
        with self.server_with_the_map("full-disk-store") as server:
            words = command("cairnctl", "--domain", server.domain, "maps", "export", "--out", out)
            done = subprocess.run(["sh", "-c", 'ulimit -f 64; exec "$@"', "sh", *words], stderr=subprocess.PIPE, text=True,
                                  timeout=LIMIT)
        self.assertEqual(done.returncode, CONFIGURATION, done.stderr)
        self.assertIn(f"{out}/map-1.cairnmap: cannot be written: File too large", done.stderr)
        self.assertEqual(list(out.iterdir()), [], "nothing is left of what failed")

    def begin_export_that_hangs(self, server, out):
        """A cairnctl whose server stopped in the middle of the export."""
        for _ in range(50):
            begun = subprocess.Popen(command("cairnctl", "--domain", server.domain, "maps", "export", "--out", out),
                                     stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
            while begun.poll() is None and not list(out.glob(".cairnctl-*")):
                time.sleep(0.001)
            server.process.send_signal(signal.SIGSTOP)
            try:
                begun.wait(timeout=1)
            except subprocess.TimeoutExpired:
                return begun
            server.process.send_signal(signal.SIGCONT)  # it was too late
            begun.communicate()
        self.fail("the server could not be stopped in time")

    def test_an_interrupted_export_leaves_nothing_hidden(self):
        out = self.folder / "interrupted"
        out.mkdir()
        with self.server_with_the_map("interrupted-store") as server:
            for ending in (signal.SIGINT, signal.SIGTERM):
                begun = self.begin_export_that_hangs(server, out)
                begun.send_signal(ending)
                try:
                    said = begun.communicate(timeout=LIMIT / 10)[1]
                finally:
                    begun.kill()
                    server.process.send_signal(signal.SIGCONT)
                self.assertEqual(begun.returncode, INTERRUPTED, said)
                self.assertIn("interrupted", said)
                self.assertEqual([p.name for p in out.glob(".cairnctl-*")], [])

    def test_an_archive_goes_to_another_server_and_grows_there(self):
        out = self.folder / "archives"
        self.ctl("maps", "export", "map-1", "--out", out)
        self.ctl("maps", "import", out / "map-1.cairnmap", expect=REFUSED)  # it is there
        here = self.ctl("map", "map-1", "show")
        with ServerProcess("--store", self.folder / "other") as other:
            there = self.ctl("maps", "import", out / "map-1.cairnmap", server=other)[0]
            self.assertEqual((there["id"], there["points"]), (here["id"], here["points"]))
            stats, said = self.track(other, "helper", "--no-new-maps")
            self.assertGreaterEqual(stats["summary"]["tracked_share"], 0.9, said)
            damaged = bytearray((out / "map-1.cairnmap").read_bytes())
            for i in range(len(damaged) // 2, len(damaged) // 2 + 10 * 4096, 4096):
                damaged[i] ^= 1
            (out / "damaged.cairnmap").write_bytes(damaged)
            self.ctl("map", "map-1", "delete", server=other)
            said = self.ctl("maps", "import", out / "damaged.cairnmap", expect=DAMAGED, server=other)
            self.assertIn("damaged.cairnmap: ", said)
            for ours in ("incoming", "transfer"):
                self.assertNotIn(ours, said)

    def test_maps_that_nobody_works_on_rest(self):
        store = self.folder / "idle"
        with ServerProcess("--store", store, "--idle-after", 1) as server:
            self.render_half()
            self.track(server, "maker", "--pace", "lockstep", recording="half")
            made = self.wait_for_rest(server)
            self.assertEqual(self.ctl("status", server=server)["maps_at_rest"], 1)
            server.kill_and_restart(0)
            self.assertTrue(self.map_1(server)["at_rest"], "from the start")
            self.assertEqual(self.map_1(server)["keyframes"], made["keyframes"])
            self.track(server, "maker", "--pace", "lockstep", "--no-new-maps")
            grown = self.wait_for_rest(server)
            self.assertGreater(grown["keyframes"], made["keyframes"])
            self.spoil(store, made, "UPDATE images SET checksum = checksum + 1 WHERE id = 2")
            server.kill_and_restart(0)
            self.assertEqual(self.map_1(server)["keyframes"], grown["keyframes"] - 1, "without the damaged one")

    def test_an_idle_map_that_cannot_be_read_back_is_served_as_it_was(self):
        store = self.folder / "unreadable"
        with ServerProcess("--store", store, "--idle-after", 1) as server:
            self.render_half()
            self.track(server, "maker", "--pace", "lockstep", recording="half")
            made = self.wait_for_rest(server)
            self.spoil(store, made, "DELETE FROM images WHERE id = 2")
            stats, said = self.track(server, "maker", "--pace", "lockstep", "--no-new-maps")
            self.assertGreaterEqual(stats["summary"]["tracked_share"], 0.5, said)
            self.assertIn("images, row 2 is missing", self.map_1(server)["failed"])
            self.assertIn("takes nothing", self.ctl("status", server=server)["health"])
            self.assertEqual(self.map_1(server)["keyframes"], made["keyframes"])

    def test_an_idle_map_is_paged_in_only_where_there_is_memory_for_its_images(self):
        store = self.folder / "little-memory"
        with ServerProcess("--store", store, "--idle-after", 1) as server:
            self.render_half()
            self.track(server, "maker", "--pace", "lockstep", recording="half")
            made = self.wait_for_rest(server)
        enough_while_idle = made["memory_bytes"] // 1_000_000 + 1
        with ServerProcess("--store", store, "--idle-after", 1, "--max-memory", enough_while_idle) as server:
            stats, said = self.track(server, "maker", "--pace", "lockstep", "--no-new-maps")
            self.assertGreaterEqual(stats["summary"]["tracked_share"], 0.5, said)
            there = self.map_1(server)
            self.assertTrue(there["at_rest"])
            self.assertEqual(there["keyframes"], made["keyframes"])
        with ServerProcess("--store", store, "--idle-after", 0, "--max-memory", 10 * enough_while_idle) as server:
            self.track(server, "maker", "--pace", "lockstep", "--no-new-maps")
            self.assertGreater(self.map_1(server)["keyframes"], made["keyframes"])

    def test_what_was_set_aside_as_damaged_is_told_until_it_is_taken_away(self):
        store = self.folder / "spoilt"
        shutil.copytree(self.folder / "store/maps", store / "maps")
        here = self.ctl("map", "map-1", "show")
        self.spoil(store, here, "UPDATE labels SET checksum = checksum + 1; "
                                "UPDATE measurements SET checksum = checksum + 1 WHERE id = 4")
        lost = {"id": "ab" * 16}
        (store / f"maps/{lost['id']}.cairnmap").write_text("this is no map " * 500)
        with ServerProcess("--store", store) as server:
            health = self.ctl("status", server=server)["health"]
            self.assertIn(f"2 damaged files were set aside in {store}/damaged", health)
            self.assertIn("backup", health)
            listed = self.ctl("maps", server=server)
            self.assertEqual([m["name"] for m in listed["maps"]], ["map-1"])
            damaged = {file["id"]: file for file in listed["damaged"]}
            self.assertEqual(self.ctl("status", server=server)["damaged"], listed["damaged"])
            self.assertEqual(damaged.keys(), {here["id"], lost["id"]})
            self.assertEqual([damaged[here["id"]][word] for word in ("name", "served")], ["map-1", True])
            self.assertIn("measurements, row 4", damaged[here["id"]]["reasons"][0])
            self.assertFalse(damaged[lost["id"]]["served"])
            self.assertIn("not a database", damaged[lost["id"]]["reasons"][0])
            said = self.say("maps", server=server)
            for words in (damaged[lost["id"]]["file"], "not a database", "not served"):
                self.assertIn(words, said)
            for file in damaged.values():
                pathlib.Path(file["file"]).unlink()
            self.assertEqual(self.ctl("maps", server=server)["damaged"], [])
            self.assertEqual(self.ctl("status", server=server)["health"], "ok")

    def test_a_map_that_cannot_be_loaded_is_told_and_does_not_stand_in_the_way_for_ever(self):
        archives = self.folder / "of-this-version"
        self.ctl("maps", "export", "map-1", "--out", archives)
        here = self.ctl("map", "map-1", "show")
        store = self.folder / "newer"
        shutil.copytree(self.folder / "store/maps", store / "maps")
        self.spoil(store, here, "PRAGMA user_version=99")
        file = store / f"maps/{here['id']}.cairnmap"
        with ServerProcess("--store", store) as server:
            self.assertEqual(self.names(server), [])
            (unloaded,) = self.ctl("maps", server=server)["unloaded"]
            self.assertEqual((unloaded["id"], unloaded["file"]), (here["id"], str(file)))
            status = self.ctl("status", server=server)
            self.assertEqual((status["unloaded"], status["unloaded_maps"]), ([unloaded], 1))
            for words in (status["health"], unloaded["reason"], self.say("maps", server=server), self.say("status", server=server)):
                self.assertIn("newer version (schema 99", words)
            self.assertIn(str(file), self.ctl("maps", "import", archives / "map-1.cairnmap", expect=REFUSED, server=server))
            file.rename(self.folder / "newer.cairnmap")
            self.ctl("maps", "import", archives / "map-1.cairnmap", server=server)
            self.assertEqual(self.names(server), ["map-1"])
            self.assertEqual(self.ctl("maps", server=server)["unloaded"], [])
            self.assertEqual(self.ctl("status", server=server)["health"], "ok")

    def test_a_deleted_map_whose_file_is_damaged_is_told_and_can_be_purged(self):
        archives = self.folder / "before-deletion"
        self.ctl("maps", "export", "map-1", "--out", archives)
        with self.server_with_the_map("deleted-spoilt") as server:
            gone = self.ctl("map", "map-1", "delete", server=server)
            self.spoil(self.folder / "deleted-spoilt", gone, "UPDATE map SET checksum = checksum + 1 WHERE id = 1", "deleted")
            (listed,) = self.ctl("maps", server=server)["deleted"]
            self.assertEqual((listed["id"], listed["name"]), (gone["id"], ""))
            self.assertIn("table map, row 1", listed["damaged"])
            self.assertIn(f"cairnctl maps purge {gone['id']}", self.say("maps", server=server))
            for words, code in ((("map", gone["id"], "undelete"), DAMAGED), (("maps", "import", archives / "map-1.cairnmap"), REFUSED)):
                self.assertIn(f"maps purge {gone['id']}", self.ctl(*words, expect=code, server=server))
            self.ctl("map", "", "undelete", expect=REFUSED, server=server)
            self.assertEqual(self.say("maps", "purge", gone["id"], "--yes", server=server), f"{gone['id']} removed for good\n")
            self.ctl("maps", "import", archives / "map-1.cairnmap", server=server)
            self.assertEqual(self.names(server), ["map-1"])

    def test_a_deleted_map_that_cannot_be_read_now_is_not_called_damaged_and_stays(self):
        with self.server_with_the_map("deleted-newer") as server:
            gone = self.ctl("map", "map-1", "delete", server=server)
            file = self.folder / f"deleted-newer/deleted/{gone['id']}.cairnmap"
            readable = file.read_bytes()
            self.spoil(self.folder / "deleted-newer", gone, "PRAGMA user_version=99", "deleted")
            (listed,) = self.ctl("maps", server=server)["deleted"]
            self.assertEqual((listed["id"], "damaged" in listed), (gone["id"], False))
            refused = [self.ctl(*words, expect=REFUSED, server=server)
                       for words in (("map", gone["id"], "undelete"), ("maps", "purge", gone["id"], "--yes"))]
            for said in (listed["unreadable"], self.say("maps", server=server), *refused):
                self.assertIn("newer version (schema 99", said)
                self.assertNotIn("purge", said)
                self.assertNotIn("damaged", said)
            file.write_bytes(readable)
            self.ctl("map", gone["id"], "undelete", server=server)
            self.assertEqual(self.names(server), ["map-1"])

    def test_a_tracker_goes_on_while_its_map_is_rolled_back(self):
        with self.server_with_the_map("versions") as server:
            tagged = self.ctl("map", "map-1", "tag", "start", server=server)
            self.assertEqual(tagged["keyframes"], self.map_1(server)["keyframes"])
            stats = self.folder / "rolled-back.json"
            tracker = subprocess.Popen(command("cairn-track", "--source", f"tum:{self.folder}/desk", "--domain", server.domain, "--name",
                                               "walker", "--headless", "--no-new-maps", "--pace", "realtime", "--stats", stats),
                                       stderr=subprocess.PIPE, text=True)
            deadline = time.monotonic() + LIMIT
            while not any(c["connected"] for c in self.ctl("clients", server=server)):
                self.assertLess(time.monotonic(), deadline)
            epochs, meanwhile = [], 0
            while tracker.poll() is None and len(epochs) < 3:
                epochs.append(self.ctl("map", "map-1", "rollback", "start", "--yes", server=server)["epoch"])
                meanwhile += tracker.poll() is None  # the recording may end during the last one
            self.assertGreater(meanwhile, 0, "it was rolled back while somebody tracked")
            _, said = tracker.communicate(timeout=LIMIT)
            self.assertEqual(tracker.returncode, OK, said)
            self.assertEqual(epochs, sorted(set(epochs)))
            summary = json.loads(stats.read_text())["summary"]
            self.assertGreaterEqual(summary["tracked_share"], 0.9, said)
            self.assertIn("--yes", self.ctl("map", "map-1", "rollback", "start", expect=USAGE, server=server))
            self.assertEqual([t["tag"] for t in self.ctl("map", "map-1", "tags", server=server)],
                             ["start"] + [f"before-rollback-{i + 1}" for i in range(len(epochs))])
            self.assertEqual(self.say("map", "map-1", "untag", "before-rollback-1", "--yes", server=server), "tag before-rollback-1 removed\n")
            self.assertIn("no tag 'never'", self.ctl("map", "map-1", "rollback", "never", "--yes", expect=REFUSED, server=server))
            self.assertEqual(self.ctl("map", "map-1", "copy", "twin", server=server)["name"], "twin")
            self.assertIn("tag start", self.say("audit", "--action", "roll back", server=server))

    def test_a_backup_during_offers_is_restored_on_another_folder(self):
        backup, restored = self.folder / "monday.tar", self.folder / "restored"
        with ServerProcess("--store", self.folder / "backed-up") as server:
            builder = subprocess.Popen(command("cairn-track", "--source", f"tum:{self.folder}/desk", "--domain", server.domain, "--name",
                                               "builder", "--headless", "--pace", "realtime"), stderr=subprocess.DEVNULL)
            deadline = time.monotonic() + LIMIT
            while not self.names(server):
                self.assertLess(time.monotonic(), deadline)
            self.ctl("rights", "grant", "phone-1", "map-1", "read", server=server)
            self.ctl("map", "map-1", "tag", "monday", server=server)
            told = self.ctl("backup", backup, server=server)
            self.assertIsNone(builder.poll(), "it was made while somebody built")
            self.assertEqual((told["file"], told["files"]), (str(backup), 3))
            self.assertEqual(backup.stat().st_mode & 0o777, 0o600)
            self.assertEqual([c["faults"] for c in self.ctl("verify", server=server)], [[], [], []])
            builder.wait(timeout=LIMIT)
            self.assertIn("backup", [e["action"] for e in self.ctl("audit", server=server)])
            there = self.map_1(server)
        self.assertIn("is there already", self.ctl("backup", backup, expect=REFUSED))
        self.assertEqual([c["name"] for c in self.ctl("verify", "--backup", backup)], ["map-1", "", ""])
        self.ctl("restore", backup, "--data", f"{restored}/")  # as a shell completes it
        self.assertIn("is not empty", self.ctl("restore", backup, "--data", restored, expect=REFUSED))
        with ServerProcess("--store", restored) as server:
            here = self.map_1(server)
            self.assertEqual(here["id"], there["id"])
            self.assertLessEqual(here["keyframes"], there["keyframes"])
            stats, said = self.track(server, "reader", "--no-new-maps", "--role", "reader", "--pace", "lockstep")
            self.assertGreaterEqual(stats["summary"]["tracked_share"], 0.5, said)
            self.assertEqual([t["tag"] for t in self.ctl("map", "map-1", "tags", server=server)], ["monday"])
            self.assertEqual([g["to"] for g in self.ctl("rights", server=server)["grants"]], ["client phone-1"])
            (restoring,) = self.ctl("audit", "--action", "restore", server=server)
            person = os.environ.get("SUDO_USER") or pwd.getpwuid(os.getuid()).pw_name
            self.assertEqual((restoring["object"], restoring["who"]), (str(restored), f"operator {person}"))
            self.assertIn("map make", [e["action"] for e in self.ctl("audit", "--who", "builder", server=server)])
        sound = backup.read_bytes()
        for name, spoilt in (("cut.tar", sound[:len(sound) // 2]), ("altered.tar", sound[:5000] + bytes([sound[5000] ^ 1]) + sound[5001:])):
            (self.folder / name).write_bytes(spoilt)
            self.assertIn(name, self.ctl("restore", self.folder / name, "--data", self.folder / "never", expect=DAMAGED))
            self.assertFalse((self.folder / "never").exists())
        self.spoil(restored, here, "UPDATE positions SET checksum = checksum + 1 WHERE id = 1")
        done = subprocess.run(command("cairnctl", "verify", "--data", restored), capture_output=True, text=True)
        self.assertEqual(done.returncode, DAMAGED, done.stderr)
        self.assertIn("table positions, row 1: the checksum is wrong", done.stdout)
        self.assertIn("remedy: a start sets the file aside", done.stdout)
        self.assertIn("1 of 3 files are damaged", done.stderr)

    def commands_of(self, *words):
        """As --help lists them."""
        said = subprocess.run(command("cairnctl", *words, "--help"), check=True, capture_output=True, text=True).stdout
        listed = said.partition("Subcommands:")[2].partition("\n\n")[0]
        return re.findall(r"^  ([a-z-]+)", listed, re.MULTILINE)

    def test_every_command_of_help_is_completed_and_on_the_page_of_the_manual(self):
        forms = {form: subprocess.run(command("cairnctl", "--help"), env={**os.environ, "CAIRN_HELP_AS": form}, check=True,
                                      capture_output=True, text=True).stdout for form in ("bash", "zsh", "man")}
        lines = [((), ())] + [((word,), ("desk",) if word in ("map", "rig") else ()) for word in self.commands_of()]
        for words, names in lines:
            script = forms["bash"] + f"\nCOMP_WORDS=(cairnctl {' '.join(words + names)} ''); COMP_CWORD=$((${{#COMP_WORDS[@]}}-1)); " \
                                     "_cairnctl; echo ${COMPREPLY[@]}"
            offered = subprocess.run(["bash", "-c", script], check=True, capture_output=True, text=True).stdout.split()
            for below in self.commands_of(*words):
                self.assertIn(below, offered, words)
                self.assertIn(f"'{below}:", forms["zsh"])
                self.assertIn(".SS cairnctl " + " ".join((*words, below)).replace("-", "\\-") + "\n", forms["man"])

    def test_watches_trackers_and_ends_one(self):
        with self.server_with_the_map("watched") as server:
            tracker = subprocess.Popen(command("cairn-track", "--source", f"tum:{self.folder}/desk", "--domain", server.domain, "--name",
                                               "walker", "--wearer", "ann", "--headless", "--no-new-maps", "--pace", "realtime"),
                                       stderr=subprocess.DEVNULL)
            deadline = time.monotonic() + LIMIT
            while not (here := self.map_1(server)).get("localized"):
                self.assertLess(time.monotonic(), deadline)
            self.assertEqual(here["clients"], 1)
            (wearer,) = self.ctl("wearers", server=server)
            self.assertEqual((wearer["wearer"], [c["name"] for c in wearer["cameras"]]), ("ann", ["walker"]))
            seen = self.ctl("top", "--once", server=server)
            self.assertIn(("walker", "map-1"), [(c["name"], c.get("map")) for c in seen["clients"]])
            self.assertGreaterEqual(seen["maps"][0]["keyframes_per_minute"], 0)
            self.ctl("clients", "kick", "walker", server=server)
            self.assertEqual(self.map_1(server)["clients"], 0)
            self.assertIn("last localized in 20", self.say("maps", server=server))
            self.assertEqual(tracker.wait(timeout=LIMIT), REFUSED)
            self.assertIn("is not connected", self.ctl("clients", "kick", "walker", expect=REFUSED, server=server))
            self.ctl("clients", "block", "shut-out", "--why", "lost", server=server)
            _, said = self.track(server, "shut-out", "--pace", "realtime", code=REFUSED)
            self.assertIn("this client is blocked", said)
            self.assertLessEqual(len(re.findall("refused to start a map: [^(]*$", said, re.MULTILINE)), 1, said)
            self.assertRegex(self.say("clients", server=server), "shut-out +(connected|away), blocked")
            (mine,) = self.ctl("map", "map-1", "contributors", server=server)
            self.assertEqual((mine["client"], mine["keyframes"]), ("builder", self.map_1(server)["keyframes"]))
            self.assertIn("nothing would be left", self.ctl("map", "map-1", "drop-contributor", "builder", "--yes", expect=REFUSED,
                                                            server=server))
            self.assertEqual(self.map_1(server)["keyframes"], mine["keyframes"])
            found = {f["what"]: f["grade"] for f in self.ctl("doctor", "--data", self.folder, server=server)}
            self.assertEqual([found[what] for what in ("interface", "server")], ["ok", "ok"])
            self.assertEqual(found.keys(), {"interface", "multicast", "server", "ports", "buffers", "clock", "disk"})

    def render_half(self):
        """The first half of the recording: the other has more to map."""
        half = self.folder / "half"
        if half.exists():
            return
        half.mkdir()
        (half / "rgb").symlink_to(self.folder / "desk/rgb")
        shutil.copy(self.folder / "desk/camera.txt", half)
        rows = (self.folder / "desk/rgb.txt").read_text().splitlines(keepends=True)
        (half / "rgb.txt").write_text("".join(rows[:len(rows) // 2]))

    def spoil(self, store, a_map, sql, part="maps"):
        with contextlib.closing(sqlite3.connect(store / part / f"{a_map['id']}.cairnmap")) as file:
            file.executescript(sql)
            file.commit()

    def map_1(self, server):
        return self.ctl("map", "map-1", "show", server=server)

    def wait_for_rest(self, server):
        deadline = time.monotonic() + LIMIT
        while not self.map_1(server)["at_rest"]:
            self.assertLess(time.monotonic(), deadline, "it does not become idle")
            time.sleep(0.1)
        return self.map_1(server)

    def test_what_is_exported_projects_onto_what_was_measured(self):
        out = self.folder / "formats"
        self.assertEqual(self.ctl("maps", "export", "--format", "all", "--out", out),
                         [str(out / "map-1"), str(out / "map-1.cairnmap")])
        here = self.ctl("map", "map-1", "show")
        header = (out / "map-1/points.ply").read_bytes()[:200].decode(errors="replace")
        vertices = int(re.search(r"element vertex (\d+)", header).group(1))
        exported = sorted(p.name for p in (out / "map-1/images").iterdir())
        self.assertEqual(len(exported), here["keyframes"])
        cameras, images, points = self.check_models(out / "map-1")
        self.assertEqual(len(points), vertices)
        self.assertLessEqual(vertices, here["points"])  # points of one view only are left out
        self.assertGreater(vertices, 0.9 * here["points"])
        self.assertEqual(sorted(name for _, _, name, _ in images.values()), exported)
        truth = next(line.split() for line in (self.folder / "desk/camera.txt").read_text().splitlines() if line[0] != "#")
        _, _, fx, fy, cx, cy, *distortion = map(float, truth)
        self.assertEqual(cameras, {1: ("OPENCV", 640, 480, (fx, fy, cx + 0.5, cy + 0.5, *distortion))})

    def test_every_kind_of_camera_is_exported_as_colmap_has_it(self):
        """The recording's lens (radial k1, k2) in other models, each within a fifth of a pixel."""
        intrinsics = {"fov": "[481.4, 480.8, 321.4, 238.2]"}
        lenses = {"plumb_bob": ("FULL_OPENCV", "[-0.18, 0.055, 0.0006, -0.0004, 0.0001]"),
                  "equidistant": ("OPENCV_FISHEYE", "[0.15276, 0.01818, -0.04078, 0.14622]"),
                  "fov": ("FOV", "[0.684]")}
        for lens, (model, distortion) in lenses.items():
            calibration = self.folder / f"{lens}.yaml"
            if lens == "plumb_bob":
                calibration.write_text("image_width: 640\nimage_height: 480\ncamera_name: hand\n"
                                       "camera_matrix: {rows: 3, cols: 3, data: [502.3, 0, 321.4, 0, 501.7, 238.2, 0, 0, 1]}\n"
                                       f"distortion_model: {lens}\ndistortion_coefficients: {{rows: 1, cols: 5, data: {distortion}}}\n")
            else:
                calibration.write_text("cam0:\n  camera_model: pinhole\n"
                                       f"  intrinsics: {intrinsics.get(lens, '[502.3, 501.7, 321.4, 238.2]')}\n"
                                       f"  distortion_model: {lens}\n  distortion_coeffs: {distortion}\n"
                                       "  resolution: [640, 480]\n")
            with self.subTest(lens), ServerProcess("--store", self.folder / lens) as server:
                self.track(server, "builder", "--calibration", f"exact:{calibration}", "--pace", "lockstep")
                for form in ("colmap-text", "colmap"):
                    self.ctl("maps", "export", "--format", form, "--out", self.folder / f"{lens}-out", server=server)
                cameras, _, _ = self.check_models(self.folder / f"{lens}-out/map-1")
                self.assertEqual([camera[0] for camera in cameras.values()], [model])

    def test_what_is_undistorted_as_the_help_says_is_of_pinholes_and_rgb(self):
        told = subprocess.run(command("cairnctl", "maps", "export", "--help"), check=True, capture_output=True, text=True).stdout
        ours, colmaps = re.search(r"^ +cairnctl (maps export desk .*)\n +colmap (image_undistorter .*)$", told, re.M).groups()
        self.ctl(*ours.replace("desk", "map-1").replace("exported", str(self.folder / "exported")).split())
        exported = list((self.folder / "exported/map-1/images").iterdir())
        self.assertEqual({colour_type(file) for file in exported}, {2}, "PNG: 2 is RGB")
        self.ctl("maps", "export", "--rgb", "--out", self.folder / "exported", expect=USAGE)
        if shutil.which("colmap"):
            out = self.folder / "undistorted"
            out.mkdir()
            places = {"exported/desk": self.folder / "exported/map-1", "--output_path undistorted": f"--output_path {out}"}
            for word, place in places.items():
                colmaps = colmaps.replace(word, str(place))
            self.colmap(*colmaps.split())
            self.assertEqual(len(list((out / "images").iterdir())), len(exported))
            cameras, images, _ = colmap_model.read_binary(out / "sparse")
            self.assertEqual({camera[0] for camera in cameras.values()}, {"PINHOLE"})
            self.assertEqual(len(images), len(exported))

    def check_models(self, folder):
        """Both forms of a model: the same, right by COLMAP's rules, and by its own word where it is installed; the content."""
        model = colmap_model.read_text(folder / "sparse-text")
        self.assertEqual(colmap_model.read_binary(folder / "sparse"), model)
        _, images, points = model
        found = colmap_model.distances(*model)
        self.assertEqual(found.keys(), points.keys())
        for number, (_, _, error, track) in points.items():
            self.assertAlmostEqual(error, sum(found[number]) / len(found[number]), delta=1e-6)
            for image, place in track:
                self.assertEqual(images[image][3][place][2], number)
        every = [d for of_point in found.values() for d in of_point]
        self.assertEqual(len(every), sum(len(track) for *_, track in points.values()))
        self.assertLess(sum(every) / len(every), 0.3)
        if shutil.which("colmap"):
            self.ask_colmap(folder, model, every)
        else:
            print("colmap is not installed (apt-get install colmap): its word is not heard", file=sys.stderr)
        return model

    def ask_colmap(self, folder, model, every):
        _, images, points = model
        for form in ("sparse", "sparse-text"):
            said = self.colmap("model_analyzer", "--path", folder / form)
            figures = {name: float(value) for name, value in re.findall(r"([A-Z][\w ]+): ([\d.]+)", said)}
            self.assertEqual([figures[name] for name in ("Registered images", "Points", "Observations")],
                             [len(images), len(points), len(every)], said)
        converted = folder / "converted"
        converted.mkdir()
        self.colmap("model_converter", "--input_path", folder / "sparse", "--output_path", converted, "--output_type", "TXT")
        self.assertEqual([len(part) for part in colmap_model.read_text(converted)], [len(part) for part in model])
        # What it makes of the model itself, not of the errors that stand in there; nothing is refined.
        still = [f"--BundleAdjustment.refine_{what}" for what in ("focal_length", "extra_params", "extrinsics")]
        said = self.colmap("bundle_adjuster", "--input_path", folder / "sparse", "--output_path", converted,
                           "--BundleAdjustment.max_num_iterations", 0, *(word for what in still for word in (what, 0)))
        own = math.sqrt(sum(d * d for d in every) / 2 / (2 * len(every)))  # Ceres' cost is half the sum of squares
        self.assertAlmostEqual(float(re.search(r"Initial cost : ([\d.]+)", said)[1]), own, delta=1e-4)
        shutil.rmtree(converted)

    def colmap(self, *words):
        done = subprocess.run(["colmap", *map(str, words)], capture_output=True, text=True, timeout=LIMIT)
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        return done.stdout + done.stderr


if __name__ == "__main__":
    programs_test.BINARIES = pathlib.Path(sys.argv.pop(1)).resolve()
    unittest.main(verbosity=2)
