# SPDX-License-Identifier: Apache-2.0
"""A display that nobody sees (Xvfb), with keys and clicks by xdotool. Standard library only."""
import os
import shutil
import subprocess

LIMIT = 300  # [s], which only a broken program takes


def is_there():
    return bool(shutil.which("Xvfb") and shutil.which("xdotool"))


class Screen:
    def __init__(self):
        # -noreset: without it a display begins anew when its last client has gone, as xdotool does twenty times a second, and refuses
        # who comes in that moment.
        self.process = subprocess.Popen(["Xvfb", "-displayfd", "1", "-screen", "0", "1280x1024x24", "-nolisten", "tcp", "-noreset"],
                                        stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        self.environment = {**os.environ, "DISPLAY": f":{self.process.stdout.readline().strip()}", "QT_QPA_PLATFORM": "xcb"}
        self.hand = None

    def close(self):
        for process in filter(None, (self.hand, self.process)):
            process.terminate()
            process.wait()
        if self.hand:
            self.hand.stdin.close()
        self.process.stdout.close()

    def do(self, *words):
        done = subprocess.run(["xdotool", *map(str, words)], env=self.environment, capture_output=True, text=True, timeout=LIMIT)
        return done.stdout if done.returncode == 0 else ""

    def press_now(self, key):
        """In the window that has the focus, without the milliseconds that a program takes to begin, from the second time on."""
        if not self.hand:
            self.hand = subprocess.Popen(["xdotool", "-"], stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, env=self.environment, text=True,
                                         bufsize=1)
        self.hand.stdin.write(f"key {key}\n")
