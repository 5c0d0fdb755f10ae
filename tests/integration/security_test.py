#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""A secured site with the programs as its people run them: an operator, two builders, a reader, a stranger.

security_test.py BIN_DIR [TestClass[.test]]   Standard library only.
"""
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import threading
import time
import unittest

import programs_test
from programs_test import LIMIT, SLOWNESS, OnTheDesk, ServerProcess, command

OK, USAGE, CONFIGURATION, NO_SERVER, REFUSED = 0, 2, 3, 4, 5
SITES = pathlib.Path(__file__).resolve().parents[2] / "deploy/sites"
HOW_TO = pathlib.Path(__file__).resolve().parents[2] / "deploy/SECURED.md"
PATIENCE = 2 * SLOWNESS  # seconds, in which a handshake is over by far


class Security(OnTheDesk):
    FRAMES = 120

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.keys("init")
        cls.keys("issue", "server")
        for client in ("builder-1", "builder-2", "reader"):
            cls.keys("issue", "client", client)
        cls.keys("issue", "operator", "ann", "--role", "administer")
        cls.keys("issue", "operator", "wat", "--role", "watch")
        cls.server = ServerProcess("--store", cls.folder / "store", "--security", cls.folder_of("server", "server"))
        cls.addClassCleanup(cls.server.__exit__)

    @classmethod
    def keys(cls, *words, keystore="keys"):
        subprocess.run(command("cairnctl", "keys", "--keys", cls.folder / keystore, *words), check=True, capture_output=True,
                       text=True, timeout=LIMIT)

    @classmethod
    def folder_of(cls, role, name, keystore="keys"):
        return cls.folder / keystore / "enclaves" / role / name

    def ctl(self, *words, operator="ann", expect=OK):
        security = ("--security", self.folder_of("operator", operator)) if operator else ()
        done = subprocess.run(command("cairnctl", "--domain", self.server.domain, "--json", *security, *words),
                              capture_output=True, text=True, timeout=LIMIT)
        self.assertEqual(done.returncode, expect, done.stderr)
        return json.loads(done.stdout) if expect == OK else done.stderr

    def client(self, name, *more, code=0, folder=None):
        return self.track(self.server, name, "--security", folder or self.folder_of("client", name), *more, code=code)

    def sees_nothing(self, *security, but="waiting for cairn-server"):
        """Though it plays the whole recording. `but`: what it does say of the server."""
        process = subprocess.Popen(command("cairn-track", "--source", f"tum:{self.folder}/desk", "--domain", self.server.domain,
                                           "--role", "reader", "--headless", *security), stderr=subprocess.PIPE, text=True)
        time.sleep(PATIENCE)
        process.terminate()
        said = process.communicate(timeout=LIMIT)[1]
        self.assertIn(but, said)
        for word in ("connected", "map-1", "desk"):
            self.assertNotIn(f" {word}", said.split(but)[1], said)

    def test_the_people_of_a_site(self):
        self.nobody_may_anything_at_first()
        self.a_builder_makes_a_map_that_a_reader_only_reads()
        self.groups_of_keys_count_and_mistyped_names_are_told()
        self.strangers_see_nothing()
        self.who_is_revoked_is_cut_off()
        self.a_backup_goes_on_elsewhere_with_the_keys_that_there_are()
        self.keys_that_do_not_fit_are_refused_with_the_remedy()

    def nobody_may_anything_at_first(self):
        _, said = self.client("builder-1", "--pace", "lockstep", code=1)
        self.assertIn("nobody at this site may make maps; `cairnctl rights explain builder-1`", said)
        self.assertEqual(self.ctl("maps")["maps"], [])
        self.ctl("rights", "create", "builder-1", "yes")
        for builder in ("builder-1", "builder-2"):
            self.ctl("rights", "grant", builder, "all", "write")
        self.ctl("rights", "grant", "reader", "all", "read")

    def a_builder_makes_a_map_that_a_reader_only_reads(self):
        stats, said = self.client("builder-1", "--pace", "lockstep")
        self.assertGreaterEqual(stats["summary"]["tracked_share"], 0.95, said)
        self.ctl("map", "map-1", "rename", "desk")
        stats, said = self.client("builder-2", "--pace", "lockstep", "--no-new-maps")
        self.assertGreaterEqual(stats["summary"]["tracked_share"], 0.9, said)
        stats, said = self.client("reader", "--pace", "lockstep", "--role", "reader")
        self.assertGreaterEqual(stats["summary"]["tracked_share"], 0.9, said)
        _, said = self.client("reader", "--pace", "lockstep", "--no-new-maps", "--labels", self.folder / "desk/labels.txt")
        self.assertRegex(said, "label .* not placed: refused: .*reader may only read here, as granted by ann")
        self.assertEqual(self.ctl("labels", "desk"), [])
        proven = {c["name"]: c["proven"] for c in self.ctl("clients")}
        self.assertEqual(proven, {"builder-1": True, "builder-2": True, "reader": True})

    def groups_of_keys_count_and_mistyped_names_are_told(self):
        self.keys("issue", "client", "hand-9", "--groups", "crew")
        deadline = time.monotonic() + LIMIT  # the server looks at its register now and then
        while not (explained := self.ctl("rights", "explain", "hand-9", "desk"))["groups"]:
            self.assertLess(time.monotonic(), deadline)
        self.assertNotIn("note", explained)
        self.assertNotIn("note", self.ctl("rights", "grant", "group crew", "all", "read"))
        explained = self.ctl("rights", "explain", "hand-9", "desk")
        self.assertEqual((explained["right"], explained["groups"]), ("read", [{"group": "crew", "by_rights": False, "by_keys": True}]))
        self.assertIn("did you mean builder-1?", self.ctl("rights", "grant", "builder-l", "desk", "none")["note"])
        self.assertIn("has keys here", self.ctl("clients", "block", "nobody")["note"])
        self.assertIn("did you mean crew?", self.ctl("rights", "grant", "group crw", "all", "read")["note"])
        self.ctl("clients", "unblock", "nobody")
        for who, which in (("builder-l", "desk"), ("group crw", "all")):
            self.ctl("rights", "revoke", who, which)

    def a_backup_goes_on_elsewhere_with_the_keys_that_there_are(self):
        backup, there = self.folder / "monday.tar", self.folder / "there"
        self.ctl("backup", backup)
        self.assertTrue(self.ctl("restore", backup, "--data", there)["secured"])
        said = subprocess.run(command("cairnctl", "restore", backup, "--data", self.folder / "again"), check=True, capture_output=True,
                              text=True, timeout=LIMIT).stdout
        self.assertIn(f"--store {self.folder / 'again'} --security DIR", said)
        ours = ServerProcess("--store", there, "--security", self.folder_of("server", "server"))
        ours.__exit__()
        self.assertNotIn("another site", ours.said)
        self.keys("issue", "server", keystore="foreign")
        foreign = ("--store", there, "--security", self.folder_of("server", "server", keystore="foreign"))
        for times in (1, 0):
            with ServerProcess(*foreign) as theirs:
                self.assertEqual(theirs.said.count("the store belongs to another site"), times, theirs.said)

    def strangers_see_nothing(self):
        self.sees_nothing("--name", "reader")
        self.keys("init", keystore="foreign")
        self.keys("issue", "client", "reader", keystore="foreign")
        foreign = self.folder_of("client", "reader", keystore="foreign")
        shutil.copy(self.folder_of("client", "reader") / "tag", foreign)
        self.sees_nothing("--security", foreign)
        # Of two who do not trust each other's authority the middleware lets either be the first to say so; of permissions both judge.
        self_signed = self.folder / "self-signed"
        shutil.copytree(self.folder_of("client", "reader"), self_signed)
        for file in ("permissions.p7s", "permissions_ca.cert.pem", "governance.p7s"):
            shutil.copy(foreign / file, self_signed)
        self.sees_nothing("--security", self_signed)
        refusals = {(e["who"], e["outcome"].split(":")[0]) for e in self.ctl("audit", "--action", "not let in")}
        self.assertIn(("somebody", "its permissions are not accepted"), refusals)
        self.assertIn("with --security", self.ctl("status", operator=None, expect=NO_SERVER))
        self.assertEqual(self.ctl("maps", operator="wat")["maps"][0]["name"], "desk")
        self.assertIn("operator wat has the role watch; this needs the role curate",
                      self.ctl("map", "desk", "rename", "table", operator="wat", expect=REFUSED))

    def who_is_revoked_is_cut_off(self):
        device = self.folder / "device"
        shutil.copytree(self.folder_of("client", "reader"), device)
        process = subprocess.Popen(command("cairn-track", "--source", "sim:desk?seed=1", "--domain", self.server.domain, "--security", device,
                                           "--role", "reader", "--headless"), stderr=subprocess.PIPE, text=True)
        deadline = threading.Timer(LIMIT, process.kill)  # ends the reading of what it says
        deadline.start()
        said = ""
        for line in process.stderr:
            said += line
            if "connected" in line:
                break
        self.keys("revoke", "client", "reader")
        for line in process.stderr:
            said += line
            if "revoked" in line:
                break
        process.terminate()
        said += process.communicate(timeout=LIMIT)[0] or ""
        deadline.cancel()
        self.assertIn("an operator has revoked the keys of this device", said)
        self.sees_nothing("--security", device, but="an operator has revoked the keys of this device")
        entries = self.ctl("audit", "--action", "turned away")
        self.assertEqual({(e["who"], e["outcome"].split(";")[0]) for e in entries}, {("client reader", "its keys were revoked")})
        self.assertGreaterEqual(len(entries), 2, "each process that tries is on record")
        self.assertTrue(next(c for c in self.ctl("clients") if c["name"] == "reader")["revoked"])
        _, said = self.client("reader", "--pace", "lockstep", code=REFUSED, folder=device)
        self.assertIn("an operator has revoked the keys of this device", said)

    def keys_that_do_not_fit_are_refused_with_the_remedy(self):
        found = subprocess.run(command("cairnctl", "--domain", self.server.domain, "--json", "--security",
                                       self.folder_of("client", "builder-1"), "doctor"), capture_output=True, text=True, timeout=LIMIT)
        self.assertEqual([f["grade"] for f in json.loads(found.stdout) if f["what"] == "server"], ["warning"], found.stdout)
        refused = subprocess.run(command("cairn-track", "--source", f"tum:{self.folder}/desk", "--security",
                                         self.folder_of("operator", "ann")), capture_output=True, text=True, timeout=LIMIT)
        self.assertEqual(refused.returncode, CONFIGURATION)
        self.assertIn("`cairnctl keys issue client`", refused.stderr)
        done = subprocess.run(command("cairn-track", "--source", f"tum:{self.folder}/desk", "--name", "builder-2", "--security",
                                      self.folder_of("client", "builder-1")), capture_output=True, text=True, timeout=LIMIT)
        self.assertEqual(done.returncode, USAGE)
        self.assertIn("the keys are of client builder-1, not of builder-2", done.stderr)
        done = subprocess.run(command("cairn-server", "--security", self.folder_of("server", "nobody")), capture_output=True,
                              text=True, timeout=LIMIT)
        self.assertEqual(done.returncode, CONFIGURATION)
        self.assertIn("`cairnctl keys issue`", done.stderr)
        for site, expected in (("secured", "enclaves/server/server"), ("open", "'nowhere': no such network interface")):
            done = subprocess.run(command("cairn-server", "--config", SITES / f"{site}.yaml", "--listen", "nowhere"), cwd=self.folder,
                                  capture_output=True, text=True, timeout=LIMIT)
            self.assertIn(expected, done.stderr)


class TenMinutes(unittest.TestCase):
    """The lines of deploy/SECURED.md as they stand there, in an empty folder, with the programs in the PATH."""
    PATIENCE = 300 * SLOWNESS

    def blocks(self):
        text = HOW_TO.read_text()
        return re.findall(r"^```\n(.*?)^```$", text[:text.index("\n**Several machines.**")], re.MULTILINE | re.DOTALL)

    def test_the_lines_do_what_they_say(self):
        keys, server, *rest = self.blocks()
        self.assertTrue(server.startswith("cairn-server "), server)
        scratch = tempfile.TemporaryDirectory()
        self.addCleanup(scratch.cleanup)
        surroundings = {**os.environ, "PATH": f"{programs_test.BINARIES}:{os.environ['PATH']}"}
        # Of one line that fails the ones behind it would say nothing.
        shell = {"cwd": scratch.name, "env": surroundings, "stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
        done = subprocess.run(["bash", "-e", "-c", keys], timeout=LIMIT, **shell)
        self.assertEqual(done.returncode, 0, done.stdout)
        serving = subprocess.Popen(["bash", "-c", f"exec {server}"], **shell)
        self.addCleanup(serving.stdout.close)
        self.addCleanup(serving.wait, LIMIT)
        self.addCleanup(serving.terminate)
        said = next(line for line in serving.stdout if "ready on" in line or "refused" in line or "in use" in line)
        if "ready on" not in said:
            self.skipTest(f"domain 0 is somebody else's: {said}")
        reader = threading.Thread(target=serving.stdout.read, daemon=True)
        reader.start()
        done = subprocess.run(["bash", "-e", "-c", "\n".join(rest)], timeout=self.PATIENCE, **shell)
        self.assertEqual(done.returncode, 0, done.stdout)
        for part in ("rights grant: client reader-1, all maps: read", "0 keyframes accepted", "on show until Friday", "revoked"):
            self.assertIn(part, done.stdout)
        self.the_machine_is_lost(serving, shell)

    def the_machine_is_lost(self, serving, shell):
        """Its backup goes on with other keys, and the lost ones pass for no server any more."""
        def told(words):
            return subprocess.run(["bash", "-e", "-c", f"KEYS=cairn-keys/enclaves; {words}"], timeout=self.PATIENCE, **shell)
        done = told("cairnctl --security $KEYS/operator/ann backup monday.tar; cp -r $KEYS/server/server lost-keys")
        self.assertEqual(done.returncode, 0, done.stdout)
        serving.terminate()
        serving.wait(LIMIT)
        text = HOW_TO.read_text()
        text = text[text.index("\n**On another machine.**"):]
        *lines, server = re.search(r"^```\n(.*?)\n```$", text, re.MULTILINE | re.DOTALL)[1].split("\n")
        done = told("mv maps lost-maps; " + "; ".join(lines) + "; cp $KEYS/server/server-2/crl.pem $KEYS/operator/ann")
        self.assertEqual(done.returncode, 0, done.stdout)
        lost = "cairn-server --store lost-maps --security lost-keys"
        for command_line, code in ((server, 0), (lost, NO_SERVER)):
            serving = subprocess.Popen(["bash", "-c", f"exec {command_line}"], **shell)
            self.addCleanup(serving.stdout.close)
            try:
                self.assertTrue(any("ready on" in line for line in serving.stdout))
                threading.Thread(target=serving.stdout.read, daemon=True).start()
                listed = told("cairnctl --security $KEYS/operator/ann maps")
                self.assertEqual(listed.returncode, code, f"{command_line}: {listed.stdout}")
            finally:
                serving.terminate()
                serving.wait(LIMIT)


if __name__ == "__main__":
    programs_test.BINARIES = pathlib.Path(sys.argv.pop(1)).resolve()
    unittest.main(verbosity=2)
