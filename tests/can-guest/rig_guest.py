#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""cairn-rig, simulated devices and cairnctl as processes on vcan0; run in the guest by guest_test.py.

rig_guest.py BIN   BIN: the folder of the programs. All times are the rig's own, which is slower by SCALE.
"""
import json
import pathlib
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time
import unittest

SCALE = 10
PATIENCE = 90  # [s] of the wall clock for what takes 1 s of the rig's
GUEST = 0.05  # [s] that processes of an emulated machine may be late; without it: rig_app_test
DOMAIN = "7"
# Homing is soon done.
RIG = """
name: shoulder
period: 10
deadlines: {commander: 60, imu: 50, drive: 50}
imu: {rate: 100}
axes:
  pan: {node: 16, gear: 20, home: -6, neutral: 0, position: [-8, 40], margin: 2, rate: 120, acceleration: 500,
        coasting: 250, gain: 20, current: 5}
  tilt: {node: 17, gear: -20, home: 6, neutral: 0, position: [-40, 8], margin: 2, rate: 120, acceleration: 500,
         coasting: 250, gain: 20, current: 5}
"""
LINE = re.compile(r"^([0-9.]+) (.*)$")


class Process:
    """One of ours, whose lines are kept as they come."""

    def __init__(self, *words, stdin=subprocess.DEVNULL):
        self.process = subprocess.Popen([str(BIN / words[0]), *words[1:]], stdin=stdin, stdout=subprocess.PIPE,
                                        stderr=subprocess.STDOUT, text=True, bufsize=1)
        self.lines = []
        self.changed = threading.Condition()
        self.thread = threading.Thread(target=self.read)
        self.thread.start()

    def read(self):
        for line in self.process.stdout:
            with self.changed:
                self.lines.append(line.rstrip("\n"))
                self.changed.notify_all()

    def wait_for(self, pattern, begin=0, unless=lambda: False):
        """The first line from `begin` on that has it; its number, or None where `unless` came first."""
        def find():
            return next((i for i in range(begin, len(self.lines)) if re.search(pattern, self.lines[i])), None)
        deadline = time.monotonic() + PATIENCE
        with self.changed:
            while find() is None and not unless():
                if time.monotonic() > deadline:
                    raise AssertionError(f"no '{pattern}' in:\n" + "\n".join(self.lines[begin:]))
                self.changed.wait(0.1)
            return find()

    def end(self, number=signal.SIGTERM):
        if self.process.poll() is None:
            self.process.send_signal(number)
        code = self.process.wait(PATIENCE)
        self.thread.join()
        self.process.stdout.close()
        return code

    def say(self, line):
        self.process.stdin.write(line + "\n")
        self.process.stdin.flush()


def commands(program, *words):
    return subprocess.run([str(BIN / program), "--domain", DOMAIN, "rig", "shoulder", *words], text=True,
                          capture_output=True, timeout=PATIENCE)


def cairnctl(*words):
    """It takes the guest ten seconds to load: what needs no more than its commands is done by rig_commander."""
    return commands("cairnctl", *words)


class Rig(unittest.TestCase):
    """One rig and its devices for all, in this order: to begin takes seconds."""

    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        config = pathlib.Path(folder.name, "shoulder.yaml")
        config.write_text(RIG)
        cls.bus = ["--can", "vcan0", "--config", str(config), "--time-scale", str(SCALE)]
        # The rig is there before its bus is.
        subprocess.run(["ip", "link", "set", "vcan0", "down"], check=True)
        cls.rig = Process("cairn-rig", *cls.bus, "--domain", DOMAIN)
        cls.addClassCleanup(cls.rig.end, signal.SIGKILL)
        cls.rig.wait_for("ready on domain")
        cls.rig.wait_for("vcan0: the interface is down; .*It is waited for")
        subprocess.run(["ip", "link", "set", "vcan0", "up"], check=True)
        cls.rig.wait_for("the bus works again")
        cls.devices = Process("cairn-rig", "simulate", *cls.bus, stdin=subprocess.PIPE)
        cls.addClassCleanup(cls.devices.end, signal.SIGKILL)

    def until_done(self, *words):
        """Until the rig takes it: who commanded before does so for 60 ms more, and drives must be heard again."""
        deadline = time.monotonic() + PATIENCE
        while (done := commands("rig_commander", *words)).returncode != 0:
            self.assertEqual(done.returncode, 5, done.stdout + done.stderr)
            self.assertLess(time.monotonic(), deadline, done.stdout + done.stderr)

    def home(self):
        self.until_done("mode", "home")

    def command(self, *mode):
        """A commander whose order moves the drives."""
        begin = len(self.devices.lines)
        deadline = time.monotonic() + PATIENCE
        while True:
            commander = Process("rig_commander", "--domain", DOMAIN, "rig", "shoulder", "mode", *mode)
            self.addCleanup(commander.end, signal.SIGKILL)
            if self.devices.wait_for("pan closed-loop", begin, lambda: commander.process.poll() is not None) is not None:
                break
            self.assertEqual(commander.end(), 5, commander.lines)  # somebody else commands it, for 60 ms more
            self.assertLess(time.monotonic(), deadline, commander.lines)
        self.devices.wait_for("tilt closed-loop", begin)
        return commander

    def inject(self, fault):
        """The number of the line that tells it."""
        begin = len(self.devices.lines)
        self.devices.say(fault)
        return self.devices.wait_for("fault " + fault.split("+")[0], begin)

    def time_of(self, number):
        return float(LINE.match(self.devices.lines[number]).group(1))

    def check_idle(self, begin, limit):
        """From line `begin` on the drives became idle within `limit` of the rig's seconds."""
        for axis in ("pan", "tilt"):
            taken = self.time_of(self.devices.wait_for(f"{axis} idle", begin)) - self.time_of(begin)
            print(f"{self.devices.lines[begin]}: {axis} idle after {1000 * taken:.0f} ms", flush=True)
            self.assertLessEqual(taken, limit, axis)

    def clear(self):
        self.until_done("clear")

    def test_1_the_doctor_finds_it_sound(self):
        doctor = subprocess.run([str(BIN / "cairn-rig"), "doctor", *self.bus], text=True, capture_output=True,
                                timeout=PATIENCE)
        self.assertEqual(doctor.returncode, 0, doctor.stdout + doctor.stderr)

    def test_2_an_order_moves_it_and_anybody_stops_it(self):
        self.home()
        commander = self.command("jog", "--rates", "8", "-8")
        second = cairnctl("mode", "neutral")
        self.assertEqual(second.returncode, 5, second.stdout + second.stderr)
        self.assertIn("commanded by", second.stderr)
        stop = cairnctl("stop", "--json")
        self.assertEqual(stop.returncode, 0, stop.stdout + stop.stderr)
        self.assertTrue(json.loads(stop.stdout)["stopped"])
        self.devices.wait_for("pan idle", self.devices.wait_for("pan closed-loop"))
        self.assertEqual(commander.process.wait(PATIENCE), 5)  # the rig has let its drives go
        self.clear()

    def test_3_without_its_commander_it_lets_the_drives_go(self):
        commander = self.command("lock")
        now = self.inject("drop+0")  # tells the time
        commander.end(signal.SIGKILL)
        self.check_idle(now, 0.25)  # 0.1, and what lies between the two
        self.rig.wait_for("the commander fell silent")

    def test_4_each_fault_stops_it_in_time(self):
        for fault, words, limit, is_lost in (("mute-imu", "the IMU does not answer", 0.1, False),
                                             ("stuck-pan", "does not follow", 0.2, False),
                                             ("mute-tilt", "does not answer", 0.1, True),
                                             ("reset-pan", r"pan \(node 16\) ", 1, True),
                                             ("bus-off", "does not answer", 1, True)):
            with self.subTest(fault):
                said = len(self.rig.lines)
                # Away from where it stands, and faster than what a stuck axis is told by.
                self.command("jog", "--rates", "8", "-8")
                injected = self.inject(fault + "+0.3")
                self.check_idle(injected, limit + GUEST)
                self.rig.wait_for(words, said)
                if "reset" not in fault:
                    self.devices.wait_for(f"fault {fault} ends", injected)
                if fault != "mute-imu":
                    self.clear()
                if is_lost:
                    self.home()

    def test_5_a_signal_stops_it_and_another_ends_it(self):
        self.command("lock")
        begin = len(self.devices.lines)
        self.rig.process.send_signal(signal.SIGUSR1)
        self.devices.wait_for("pan idle", begin)
        self.devices.wait_for("tilt idle", begin)
        self.rig.wait_for("emergency stop by signal")
        self.clear()
        self.command("lock")
        begin = len(self.devices.lines)
        self.assertEqual(self.rig.end(), 0)
        self.devices.wait_for("pan idle", begin)
        self.assertEqual(self.devices.end(), 0)
        for line in self.devices.lines[-2:]:
            self.assertIn("never at its hard stop", line)


if __name__ == "__main__":
    BIN = pathlib.Path(sys.argv.pop(1)).resolve()
    unittest.main(verbosity=2, failfast=True)
