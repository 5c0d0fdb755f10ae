#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""run-in-can-guest, and in it the test of hw/can on the kernel's CAN and that of a rig: one start of the guest for all.

guest_test.py CAN_SOCKET_TEST [BIN]   BIN: folder of cairn-rig and cairnctl; without it, no rig. Exit code 77: there is no guest here (a failure where CI=true).
"""
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile
import unittest

NOT_HERE = 77
NO_GUEST = 125
LIMIT = 540  # [s] of the whole; a loaded machine takes a third of it
RUN = pathlib.Path(__file__).resolve().with_name("run-in-can-guest")

# In the guest the kernel has CAN, so the other way of run-in-can-guest works there.
INSIDE = """
"$0" || exit 1
if [ -n "$2" ]; then "$3" "${1%/*}/rig_processes.py" "$2" vcan0 >&2 || exit 3; fi
echo said >&2
"$1" --backend native bash -c 'ip link show vcan1 >&2 && exit 41'
test $? = 41 || exit 2
exit 42
"""


def run(*arguments, **environment):
    return subprocess.run([RUN, *arguments], capture_output=True, text=True, timeout=LIMIT + 20,
                          env={**os.environ, **environment})


class Guest(unittest.TestCase):
    def test_words_and_exit_codes_pass_and_the_kernels_can_is_as_hw_can_expects(self):
        done = run("--skip", "--kvaser", "--timeout", str(LIMIT), "bash", "-c", INSIDE, PROGRAM, str(RUN), PROGRAMS,
                   sys.executable)  # not by a name, which may be that of a script that looks for it
        if done.returncode == NOT_HERE:
            print(done.stderr, file=sys.stderr)
            self.skipTest(done.stderr)
        self.assertEqual(done.returncode, 42, done.stdout + done.stderr)
        print(done.stderr)  # what took how long
        self.assertIn("[  PASSED  ]", done.stdout)
        self.assertIn("said\n", done.stderr)
        self.assertNotIn("said", done.stdout)


class WithoutPackages(unittest.TestCase):
    def setUp(self):
        scratch = tempfile.TemporaryDirectory()
        self.addCleanup(scratch.cleanup)
        for name in ("bash", "env", "dirname", "readlink", "id", "uname"):
            pathlib.Path(scratch.name, name).symlink_to(shutil.which(name))
        self.path = scratch.name

    def test_it_is_a_skip_that_says_what_to_install_and_an_error_in_ci(self):
        for ci, code in (("", NOT_HERE), ("true", NO_GUEST)):
            done = run("--skip", "true", PATH=self.path, CI=ci)
            self.assertEqual(done.returncode, code, done.stderr)
            self.assertIn("deploy/install-packages can-guest", done.stderr)
        self.assertEqual(run("true", PATH=self.path, CI="").returncode, NO_GUEST)


class Usage(unittest.TestCase):
    def test_what_it_does_not_know_is_told(self):
        for arguments, words in (([], "no command"), (["--bogus"], "unknown option '--bogus'"),
                                 (["--timeout", "x", "true"], "--timeout x"), (["--timeout"], "--timeout needs a value"),
                                 (["--backend", "none", "true"], "there are auto, native, qemu and uml")):
            done = run(*arguments)
            self.assertEqual(done.returncode, 2, done.stderr)
            self.assertIn(words, done.stderr)
        self.assertEqual(run("--help").returncode, 0)


if __name__ == "__main__":
    if len(sys.argv) < 2 or sys.argv[1] in ("-h", "--help"):
        print(__doc__.strip())
        sys.exit(0 if len(sys.argv) > 1 else 2)
    PROGRAM = str(pathlib.Path(sys.argv.pop(1)).resolve())
    PROGRAMS = str(pathlib.Path(sys.argv.pop(1)).resolve()) if len(sys.argv) > 1 else ""
    result = unittest.main(verbosity=2, exit=False).result
    sys.exit(1 if not result.wasSuccessful() else NOT_HERE if result.skipped else 0)
