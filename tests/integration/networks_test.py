#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The programs on machines of several networks, and when an address changes under them. Each machine is a network
namespace of its own, for which root and `ip netns` are needed; without them those tests are skipped.

networks_test.py BIN_DIR [TestClass[.test]]   Standard library only.
"""
import os
import pathlib
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import unittest

BINARIES = None
SLOWNESS = int(os.environ.get("CAIRN_TEST_SLOWNESS", "1"))
LIMIT = 120 * SLOWNESS  # seconds, which only a broken program takes
DOMAIN = 7  # within namespaces: nobody else is there
FREE_DOMAINS = range(120, 200)


def ip(*words):
    subprocess.run(["ip", *words], check=True)


def why_no_namespaces():
    if os.geteuid() != 0:
        return "network namespaces need root"
    if shutil.which("ip") is None:
        return "there is no `ip` (package iproute2)"
    name = f"cairn-try-{os.getpid()}"
    tried = subprocess.run(["ip", "netns", "add", name], stderr=subprocess.PIPE, text=True)
    if tried.returncode != 0:
        return "no network namespaces here: " + tried.stderr.strip()
    entered = subprocess.run(["ip", "netns", "exec", name, "true"], stderr=subprocess.PIPE, text=True)
    ip("netns", "del", name)
    return "" if entered.returncode == 0 else "no network namespaces here: " + entered.stderr.strip()


class Program:
    """One that runs on a machine; what it says is read all the time."""

    def __init__(self, machine, name, *words):
        self.process = subprocess.Popen(["ip", "netns", "exec", machine, str(BINARIES / name), *map(str, words)],
                                        stderr=subprocess.PIPE, text=True)
        self.said = ""
        self.reader = threading.Thread(target=self.read, daemon=True)
        self.reader.start()

    def read(self):
        for line in self.process.stderr:
            self.said += line

    def await_words(self, words, after=0):
        """Until it has said them behind the first `after` letters: where they end."""
        deadline = time.monotonic() + LIMIT
        while (at := self.said.find(words, after)) < 0:
            if time.monotonic() > deadline or (self.process.poll() is not None and not self.reader.is_alive()):
                raise AssertionError(f"never said '{words}': {self.said}")
            time.sleep(0.01)
        return at + len(words)

    def end(self, code):
        self.process.send_signal(signal.SIGTERM)
        found = self.process.wait(timeout=LIMIT)
        self.reader.join(timeout=LIMIT)
        if found != code:
            raise AssertionError(f"ended with {found}, not {code}: {self.said}")

    def kill(self):
        self.process.kill()
        self.process.wait()
        self.reader.join(timeout=LIMIT)
        self.process.stderr.close()


class Networks(unittest.TestCase):
    """A server's machine and a tracker's, with `air` between them. The tracker's has a container engine's bridge
    before that, and the server's a cable to somewhere else."""

    @classmethod
    def setUpClass(cls):
        if why := why_no_namespaces():
            raise unittest.SkipTest(why)

    def setUp(self):
        self.server, self.client = (f"cairn-{kind}-{os.getpid()}" for kind in ("server", "client"))
        self.running = []
        scratch = tempfile.TemporaryDirectory()
        self.addCleanup(scratch.cleanup)
        self.store = pathlib.Path(scratch.name) / "store"
        for machine in (self.server, self.client):
            ip("netns", "add", machine)
            self.addCleanup(ip, "netns", "del", machine)
            ip("-n", machine, "link", "set", "lo", "up")
        for machine, bridge, address in ((self.client, "docker0", "172.17.0.1/16"), (self.server, "cable", "192.168.1.1/24")):
            ip("-n", machine, "link", "add", bridge, "type", "bridge")
            ip("-n", machine, "addr", "add", address, "dev", bridge)
            ip("-n", machine, "link", "set", bridge, "up")
        ip("link", "add", "air", "netns", self.server, "type", "veth", "peer", "name", "wlan0", "netns", self.client)
        ip("-n", self.server, "addr", "add", "10.77.0.1/24", "dev", "air")
        ip("-n", self.client, "addr", "add", "10.77.0.2/24", "dev", "wlan0")
        ip("-n", self.server, "link", "set", "air", "up")
        ip("-n", self.client, "link", "set", "wlan0", "up")
        ip("-n", self.server, "route", "add", "default", "via", "10.77.0.2")
        self.addCleanup(lambda: [program.kill() for program in self.running])

    def start(self, machine, name, *words):
        self.running.append(Program(machine, name, "--domain", DOMAIN, *words))
        return self.running[-1]

    def serve(self, *words):
        server = self.start(self.server, "cairn-server", "--profile", "wifi", *words)
        server.await_words(": ready on")
        return server

    def track(self, host, *words):
        tracker = self.start(self.client, "cairn-track", "--server", host, "--name", "anna", "--headless", "--source",
                             "sim:desk?seed=1", *words)
        tracker.await_words("connected to")
        return tracker

    def ask(self, *words):
        return subprocess.run(["ip", "netns", "exec", self.client, str(BINARIES / "cairnctl"), "--domain", str(DOMAIN),
                               *words, "status"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, timeout=LIMIT)

    def move(self, machine, interface, old, new):
        ip("-n", machine, "addr", "del", f"{old}/24", "dev", interface)
        if new:
            ip("-n", machine, "addr", "add", f"{new}/24", "dev", interface)

    def test_the_interface_is_that_of_the_route(self):
        server = self.serve()
        self.assertIn("air (10.77.0.1)", server.said)
        for listen in ((), ("--listen", "wlan0"), ("--listen", "10.77.0.2")):
            done = self.ask("--server", "10.77.0.1", *listen)
            self.assertEqual(done.returncode, 0, done.stderr)
        self.track("10.77.0.1").end(130)
        server.end(0)
        self.assertNotIn("dds:", server.said)

    def test_who_hears_nothing_says_where_it_asked(self):
        ip("-n", self.server, "route", "del", "default")  # by which it would answer to any address
        self.serve("--listen", "air")
        done = self.ask("--server", "10.77.0.1", "--listen", "docker0")
        self.assertEqual(done.returncode, 4, done.stderr)
        self.assertIn("docker0 (172.17.0.1)", done.stderr)
        done = self.ask("--server", "10.88.0.1")  # to which no route leads
        self.assertEqual(done.returncode, 4, done.stderr)
        self.assertIn("wlan0 (10.77.0.2)", done.stderr)

    def test_a_tracker_whose_address_changes_joins_anew(self):
        self.serve()
        tracker = self.track("10.77.0.1")
        tracker.await_words("the server made map")
        self.move(self.client, "wlan0", "10.77.0.2", "10.77.0.9")
        told = tracker.await_words("by wlan0 (10.77.0.9) instead of wlan0 (10.77.0.2)")
        connected = tracker.await_words("connected to", told)
        tracker.await_words(" accepted", connected)  # a seed or a keyframe of the new session
        tracker.end(130)
        self.assertNotIn("another live process", tracker.said)
        self.assertNotIn("does not close", tracker.said)

    def test_without_an_address_both_programs_end(self):
        server = self.serve("--store", self.store)
        tracker = self.track("10.77.0.1")
        self.move(self.client, "wlan0", "10.77.0.2", None)
        self.move(self.server, "air", "10.77.0.1", None)
        tracker.await_words("no network of this machine leads to the server")
        server.await_words("trackers elsewhere are not heard")
        ip("-n", self.server, "addr", "add", "10.77.0.5/24", "dev", "air")
        server.await_words("serving again, on air (10.77.0.5)")
        tracker.end(130)
        server.end(0)

    def test_a_server_that_moves_is_found_by_its_name(self):
        folder = pathlib.Path("/etc/netns") / self.client
        folder.mkdir(parents=True)
        self.addCleanup(shutil.rmtree, folder)
        (folder / "hosts").write_text("10.77.0.1 desk-pc\n")
        server = self.serve("--listen", "air", "--store", self.store)
        tracker = self.track("desk-pc")
        tracker.await_words("the server made map")
        self.move(self.server, "air", "10.77.0.1", "10.77.0.5")
        server.await_words("serving again, on air (10.77.0.5)", server.await_words("serving anew from the store"))
        (folder / "hosts").write_text("10.77.0.5 desk-pc\n")
        told = tracker.await_words("'desk-pc' has the address 10.77.0.5 instead of 10.77.0.1")
        tracker.await_words("connected to", told)
        tracker.end(130)
        self.assertNotIn("restarted without this map", tracker.said)
        server.end(0)
        self.assertNotIn("does not close", server.said + tracker.said)

    def test_a_server_without_store_says_what_to_do(self):
        server = self.serve("--listen", "air")
        self.move(self.server, "air", "10.77.0.1", "10.77.0.5")
        server.await_words("air (10.77.0.5) instead of air (10.77.0.1)")
        server.await_words("Start the server again")
        server.end(0)


class Ports(unittest.TestCase):
    def test_whoever_holds_the_servers_port_is_named(self):
        for domain in FREE_DOMAINS:
            for second in (0, 1):
                port = 7410 + 250 * domain + second
                with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as holder:
                    try:
                        holder.bind(("", port))
                    except OSError:
                        break
                    done = subprocess.run([str(BINARIES / "cairn-server"), "--domain", str(domain)], stderr=subprocess.PIPE,
                                          text=True, timeout=LIMIT)
                self.assertEqual(done.returncode, 5, done.stderr)
                self.assertIn(f"UDP port {port}", done.stderr)
                self.assertIn(f"(process {os.getpid()}), another program", done.stderr)
            else:
                return
        self.fail("no free domain")


if __name__ == "__main__":
    BINARIES = pathlib.Path(sys.argv.pop(1))
    unittest.main(verbosity=2)
