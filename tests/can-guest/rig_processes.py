#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""cairn-rig, simulated devices and commanders as processes: how soon the drives are idle after each fault and each stop.

rig_processes.py BIN [IFACE]   BIN: the folder of the programs. IFACE: vcan0 of the guest, where guest_test.py runs it; without one, a pair of
sockets that both programs are started with. All times are the rig's own, which are slower by SCALE; a table of them is printed.
"""
import pathlib
import re
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import unittest

PATIENCE = 90  # [s] of the wall clock for what takes 1 s of the rig's
LATE = 0.05  # [s] that processes of an emulated or loaded machine may be late; without it: rig_app_test
ATTEMPTS = 3  # at a fault: where others kept the processor, another one is in time
STOP, WATCHDOG, STUCK, RECOVERY = 0.05, 0.1, 0.2, 1  # [s] until the drives are idle
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


class Kernel:
    """A bus of the kernel's, in a machine that may be emulated on a loaded one: a drive that pauses for 50 ms is a dead one."""
    scale = 10

    def __init__(self, interface):
        self.of_rig = self.of_devices = {"words": ["--can", interface]}
        self.interface = interface

    def close(self):
        pass


class Pair:
    """The two ends of a bus without a kernel's; they outlive the programs."""
    scale = 5
    interface = None

    def __init__(self):
        self.ends = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.of_rig, self.of_devices = ({"words": ["--can", f"fd:{end.fileno()}"], "pass_fds": (end.fileno(),)} for end in self.ends)

    def close(self):
        for end in self.ends:
            end.close()


class Process:
    """One of ours, whose lines are kept as they come, each with the time of the machine."""

    def __init__(self, *words, stdin=subprocess.DEVNULL, pass_fds=()):
        self.process = subprocess.Popen([str(BIN / words[0]), *words[1:]], stdin=stdin, stdout=subprocess.PIPE,
                                        stderr=subprocess.STDOUT, text=True, bufsize=1, pass_fds=pass_fds)
        self.lines = []
        self.came = []
        self.changed = threading.Condition()
        self.thread = threading.Thread(target=self.read)
        self.thread.start()

    def read(self):
        for line in self.process.stdout:
            with self.changed:
                self.came.append(time.monotonic())
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
        for stream in (self.process.stdout, self.process.stdin):
            if stream:
                stream.close()
        return code

    def say(self, line):
        self.process.stdin.write(line + "\n")
        self.process.stdin.flush()


def commands(program, *words):
    return subprocess.run([str(BIN / program), "--domain", DOMAIN, "rig", "shoulder", *words], text=True,
                          capture_output=True, timeout=PATIENCE)


class Rig(unittest.TestCase):
    """One rig and its devices for all, in this order: to begin takes seconds."""

    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.addClassCleanup(BUS.close)
        config = pathlib.Path(folder.name, "shoulder.yaml")
        config.write_text(RIG)
        cls.table = []
        cls.more = ["--config", str(config), "--time-scale", str(BUS.scale)]
        if BUS.interface:  # the rig is there before its bus is
            subprocess.run(["ip", "link", "set", BUS.interface, "down"], check=True)
        cls.begin_rig()
        if BUS.interface:
            cls.rig.wait_for(f"{BUS.interface}: the interface is down; .*It is waited for")
            subprocess.run(["ip", "link", "set", BUS.interface, "up"], check=True)
            cls.rig.wait_for("the bus works again")
        cls.devices = cls.start(BUS.of_devices, "simulate", stdin=subprocess.PIPE)

    @classmethod
    def start(cls, end, *words, **more):
        process = Process("cairn-rig", *words, *end["words"], *cls.more, pass_fds=end.get("pass_fds", ()), **more)
        cls.addClassCleanup(process.end, signal.SIGKILL)
        return process

    @classmethod
    def begin_rig(cls):
        cls.rig = cls.start(BUS.of_rig, "--domain", DOMAIN)
        cls.rig.wait_for("ready on domain")

    @classmethod
    def tearDownClass(cls):
        print(f"\n{'what':34} {'pan':>7} {'tilt':>7} {'named':>7} {'limit':>7}   ms of the rig, on {BUS.interface or 'a pair of sockets'}")
        for what, times, named, limit in cls.table:
            words = [f"{1000 * t:.0f}" for t in times] + ["" if named is None else f"{1000 * named:.0f}", f"{1000 * limit:.0f}"]
            print(f"{what:34} " + " ".join(f"{word:>7}" for word in words), flush=True)

    def until_done(self, *words, meanwhile=lambda: None):
        """Until the rig takes it: who commanded before does so for 60 ms more, drives must be heard again, and on a busy machine it takes
        a while until rig and commander have found each other."""
        deadline = time.monotonic() + PATIENCE
        not_yet = (4, 5)  # no rig answers; it refuses
        while (done := commands("rig_commander", *words)).returncode != 0:
            self.assertIn(done.returncode, not_yet, done.stdout + done.stderr)
            self.assertLess(time.monotonic(), deadline, done.stdout + done.stderr)
            meanwhile()

    def home(self):
        """Drives that were late are cleared, as a person would."""
        self.until_done("mode", "home", meanwhile=lambda: commands("rig_commander", "clear"))

    def clear(self):
        self.until_done("clear")

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
            if any("home it first" in line for line in commander.lines):  # drives that were late let go while they homed
                self.home()
        self.devices.wait_for("tilt closed-loop", begin)
        return commander

    def jog(self):
        """Away from where it stands, and faster than what a stuck axis is told by."""
        return self.command("jog", "--rates", "8", "-8")

    def inject(self, fault):
        """The number of the line that tells it."""
        begin = len(self.devices.lines)
        self.devices.say(fault)
        return self.devices.wait_for("fault " + fault.split("+")[0], begin)

    def mark(self):
        """The line of a fault that is none, which tells the time."""
        return self.inject("drop+0")

    def time_of(self, number):
        return float(LINE.match(self.devices.lines[number]).group(1))

    def time_until_idle(self, what, begin, limit, named=None):
        """The rig's seconds from line `begin` on until both drives were idle and the rig had said why: in a line of its log from
        number on, as the pattern has it."""
        times = [self.time_of(self.devices.wait_for(f"{axis} idle", begin)) - self.time_of(begin) for axis in ("pan", "tilt")]
        said = None
        if named:
            number = self.rig.wait_for(*named)
            said = max(0.0, (self.rig.came[number] - self.devices.came[begin]) / BUS.scale)
        self.table.append((what, times, said, limit))
        return max(*times, said or 0)

    def check_idle(self, what, begin, limit, named=None):
        self.assertLessEqual(self.time_until_idle(what, begin, limit, named), limit + LATE, what)

    def test_1_the_doctor_finds_it_sound(self):
        if not BUS.interface:
            self.skipTest("it listens to interfaces")
        doctor = subprocess.run([str(BIN / "cairn-rig"), "doctor", "--can", BUS.interface, *self.more], text=True, capture_output=True,
                                timeout=PATIENCE)
        self.assertEqual(doctor.returncode, 0, doctor.stdout + doctor.stderr)

    def test_2_an_order_moves_it_and_anybody_stops_it(self):
        # It takes the guest ten seconds to load cairnctl: what needs no more than its commands is done by rig_commander.
        program = "rig_commander" if BUS.interface else "cairnctl"
        self.home()
        commander = self.jog()
        second = commands(program, "mode", "neutral")
        self.assertEqual(second.returncode, 5, second.stdout + second.stderr)
        self.assertIn("commanded by", second.stderr)
        begin = self.mark()
        stop = commands(program, "stop")
        self.assertEqual(stop.returncode, 0, stop.stdout + stop.stderr)
        self.devices.wait_for("pan idle", begin)
        self.devices.wait_for("tilt idle", begin)
        self.assertIn("mode     stop", stop.stdout)
        self.assertEqual(commander.process.wait(PATIENCE), 5)  # the rig has let its drives go
        self.clear()

    def test_3_an_order_to_stop_is_carried_out_at_once(self):
        self.jog()
        with_line = Process("rig_commander", "--domain", DOMAIN, "--stop-on-word", "shoulder", stdin=subprocess.PIPE)
        self.addCleanup(with_line.end, signal.SIGKILL)
        with_line.wait_for("ready")
        begin = self.mark()
        with_line.say("now")
        self.check_idle("stop ordered", begin, STOP)
        with_line.wait_for("stopped")
        self.clear()

    def test_4_a_signal_stops_it(self):
        self.command("lock")
        begin = self.mark()
        self.rig.process.send_signal(signal.SIGUSR1)
        self.check_idle("stop by signal", begin, STOP)
        self.rig.wait_for("emergency stop by signal")
        self.clear()

    def test_5_without_its_commander_it_lets_the_drives_go(self):
        commander = self.command("lock")
        said = len(self.rig.lines)
        begin = self.mark()
        commander.process.kill()
        self.check_idle("commander killed", begin, WATCHDOG, ("the commander fell silent", said))

    def test_6_each_fault_stops_it_in_time(self):
        for fault, words, limit, is_lost in (("mute-imu", "the IMU does not answer", WATCHDOG, False),
                                             ("stuck-pan", "does not follow", STUCK, False),
                                             ("mute-tilt", "does not answer", WATCHDOG, True),
                                             ("reset-pan", r"pan \(node 16\) ", RECOVERY, True),
                                             ("bus-off", "does not answer", RECOVERY, True)):
            if BUS.interface and fault == "mute-tilt":
                continue  # homing takes the guest ten seconds
            with self.subTest(fault):
                for _ in range(ATTEMPTS):
                    self.jog()
                    said = len(self.rig.lines)  # what it said before is of another fault
                    injected = self.inject(fault + "+0.3")
                    late = self.time_until_idle(fault, injected, limit, (words, said)) > limit + LATE
                    if "reset" not in fault:
                        self.devices.wait_for(f"fault {fault} ends", injected)
                    if fault != "mute-imu":
                        self.clear()
                    if is_lost:
                        self.home()
                    if not late:
                        break
                self.assertFalse(late, f"{fault}: late {ATTEMPTS} times")

    def test_7_without_the_rigs_program_the_drives_let_go_and_another_one_takes_them_up(self):
        self.jog()
        begin = self.mark()
        self.rig.process.kill()
        self.check_idle("cairn-rig killed", begin, WATCHDOG)
        self.rig.end()
        self.begin_rig()
        self.rig.wait_for("had no setpoint in time")  # by their own watchdogs
        self.clear()
        self.home()

    def test_8_a_signal_ends_it_with_idle_drives(self):
        self.command("lock")
        begin = len(self.devices.lines)
        self.assertEqual(self.rig.end(), 0)
        self.devices.wait_for("pan idle", begin)
        self.assertEqual(self.devices.end(), 0)
        for line in self.devices.lines[-2:]:
            self.assertIn("never at its hard stop", line)


if __name__ == "__main__":
    if len(sys.argv) < 2 or sys.argv[1] in ("-h", "--help"):
        print(__doc__.strip())
        sys.exit(0 if len(sys.argv) > 1 else 2)
    BIN = pathlib.Path(sys.argv.pop(1)).resolve()
    BUS = Kernel(sys.argv.pop(1)) if len(sys.argv) > 1 and sys.argv[1][0] != "-" else Pair()
    DOMAIN = "229"
    unittest.main(verbosity=2, failfast=True)
