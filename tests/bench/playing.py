# SPDX-License-Identifier: Apache-2.0
"""What the programs of this folder share that play sequences through cairn-server and cairn-track. Standard library only."""
import math
import pathlib
import signal
import subprocess
import sys

PROGRAM = pathlib.Path(sys.argv[0]).name
STOP_DEADLINE_S = 30
CUBE_CAMERA = pathlib.Path(__file__).resolve().parents[2] / "deploy/demo-data/cube-camera.txt"


class Sequence:
    def __init__(self, text, calibration):
        self.source = None
        self.truth = None
        self.calibration = None
        if text.startswith("sim:"):
            self.name = text
            return
        if text.startswith("images:"):
            folder = pathlib.Path(text.removeprefix("images:").partition("?")[0])
            if not folder.is_dir():
                sys.exit(f"{PROGRAM}: {folder}: no such folder")
            self.name = folder.name
            self.source = text if "?" in text else f"{text}?fps=25"
            own = first_existing(folder, ["camera.txt"])
            self.calibration = own or calibration or (CUBE_CAMERA if self.name == "cube" else None)
            return
        folder = pathlib.Path(text)
        if not folder.is_dir():
            sys.exit(f"{PROGRAM}: {folder}: no such folder")
        self.name = folder.name
        if (folder / "rgb.txt").exists():
            self.source = f"tum:{folder}"
        elif (folder / "video.mp4").exists():
            self.source = f"video:{folder}/video.mp4?times={folder}/times.txt"
        else:
            sys.exit(f"{PROGRAM}: {folder}: neither rgb.txt nor video.mp4")
        self.calibration = first_existing(folder, ["camera.txt", "camera-colmap.txt"]) or calibration
        self.truth = first_existing(folder, ["groundtruth-colmap.txt", "groundtruth.txt"])


def first_existing(folder, names):
    return next((folder / name for name in names if (folder / name).exists()), None)


def render(sequence, binaries, folder):
    """Renders a scenario as a TUM recording: pictures, calibration and exact truth."""
    scenario, _, options = sequence.name.removeprefix("sim:").partition("?")
    command = [binaries / "cairn-sim", "render", scenario, "--out", folder / "sequence"]
    for option in filter(None, options.split("&")):
        key, _, value = option.partition("=")
        command += [f"--{key}", value]
    subprocess.run([str(c) for c in command], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    sequence.source = f"tum:{folder}/sequence"
    sequence.truth = folder / "sequence" / "groundtruth.txt"


def memory_mb(process_id, kind):
    """Of a process that runs: VmRSS (resident) or VmHWM (the most there was) [MB]. None: not known."""
    try:
        for line in pathlib.Path(f"/proc/{process_id}/status").read_text().splitlines():
            if line.startswith(f"{kind}:"):
                return int(line.split()[1]) * 1024 / 1e6
    except OSError:
        pass
    return None


class Server:
    """A cairn-server of its own; its words go to server.log in the folder, at its end its figures to server.json."""

    def __init__(self, binaries, domain, seed, folder, *more):
        self.log = open(folder / "server.log", "w")
        command = [binaries / "cairn-server", "--domain", domain, "--seed", seed, "--stats", folder / "server.json", *more]
        self.process = subprocess.Popen([str(word) for word in command], stdout=subprocess.DEVNULL, stderr=self.log)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()
        self.log.close()

    def memory_mb(self):
        """Resident now."""
        return memory_mb(self.process.pid, "VmRSS")

    def peak_memory_mb(self):
        return memory_mb(self.process.pid, "VmHWM")

    def stop(self):
        """Its exit code."""
        self.process.send_signal(signal.SIGTERM)
        return self.process.wait(timeout=STOP_DEADLINE_S)


def track_command(binaries, sequence, domain, name, pace, seed, stats, finds_camera=False):
    """cairn-track as a list of words."""
    command = [binaries / "cairn-track", "--source", sequence.source, "--domain", domain, "--name", name, "--pace", pace,
               "--seed", seed, "--headless", "--stats", stats]
    calibration = "auto" if finds_camera else sequence.calibration
    if calibration:
        command += ["--calibration", calibration]
    return [str(word) for word in command]


def is_tracked(frame):
    """Of a row of `frames` in the stats: a pose was measured."""
    return frame["state"] in ("tracking", "poor")


def is_on_time(frame):
    """Likewise: what came of it came within 33 ms of when the frame was due. A lost frame has no pose: it is late. Before there is
    a map none can have one, so these count by their time alone (as `on_time_share` of the stats' summary)."""
    return frame["state"] not in ("dropped", "lost") and frame["wall_ms"] <= 33.0


def rows_of(path):
    """The fields of each row of a text file, without comments and blank lines."""
    return [line.split() for line in path.read_text().splitlines() if line and not line.startswith("#")]


def percentile(values, share):
    """The nearest rank; "-" of no values."""
    ranked = sorted(values)
    return ranked[max(0, math.ceil(share * len(ranked)) - 1)] if ranked else "-"
