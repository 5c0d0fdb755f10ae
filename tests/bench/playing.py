# SPDX-License-Identifier: Apache-2.0
"""What the programs of this folder share that start cairn's programs and judge what came of it. Standard library only.

Their exit codes: 1 something failed or was missed, 2 usage or no build; a line on stderr says why.
"""
import argparse
import json
import math
import os
import pathlib
import signal
import subprocess
import sys
import tempfile

PROGRAM = pathlib.Path(sys.argv[0]).name
STOP_DEADLINE_S = 30
CUBE_CAMERA = pathlib.Path(__file__).resolve().parents[2] / "deploy/demo-data/cube-camera.txt"
CUBE_NAMES = ("cube", "visp-cube-poster")  # one recording, in Debian's package and among the recordings
ON_TIME_MS = 33.0  # as kOnTimeMs of client/app/on_time.h
LAST_DOMAIN = 230


class Failure(Exception):
    """A program did not do what it was started for: why, in a line."""


def finish(main):
    """Ends the program with what main returns, or with a line about what failed."""
    try:
        sys.exit(main())
    except Failure as failure:
        complain(failure)
        sys.exit(1)


def complain(text):
    sys.stdout.flush()
    print(f"{PROGRAM}: {text}", file=sys.stderr, flush=True)


def refuse(why):
    """Ends the program, before it has run anything."""
    complain(why)
    sys.exit(2)


def at_least(least):
    """A type for argparse: whole numbers from there on."""
    def parse(text):
        try:
            number = int(text)
        except ValueError:
            number = least - 1
        if number < least:
            raise argparse.ArgumentTypeError(f"'{text}': expected a whole number from {least}")
        return number
    return parse


def add_niceness(parser, who):
    parser.add_argument("--nice", type=at_least(0), default=0, metavar="N", help=f"niceness of {who}, which at a site have machines "
                        "of their own: with 19 they take what server and builder leave (default: %(default)s)")


def giving_way(arguments):
    """What goes before the words of a process that has the niceness of add_niceness."""
    return ["nice", "-n", str(arguments.nice)] if arguments.nice else []


def output_file(text):
    """A type for argparse: a path for `write_json`."""
    path = pathlib.Path(text)
    if not path.parent.is_dir():
        raise argparse.ArgumentTypeError(f"{path.parent}: no such folder")
    if path.exists() and not path.is_file():
        raise argparse.ArgumentTypeError(f"{path}: not a file")
    if not os.access(path.resolve().parent, os.W_OK):
        raise argparse.ArgumentTypeError(f"{path.parent}: may not be written")
    return path


def output_folder(text):
    """A type for argparse: a folder, made if missing."""
    path = pathlib.Path(text)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise argparse.ArgumentTypeError(f"{path}: {error.strerror}")
    return path


def file_of_camera(calibration):
    """Of FILE, auto:FILE or exact:FILE, as cairn-track takes them."""
    return pathlib.Path(str(calibration).removeprefix("auto:").removeprefix("exact:"))


def camera(text):
    """A type for argparse: a calibration, or `auto`."""
    if text != "auto" and not file_of_camera(str(text).partition("#")[0]).is_file():
        raise argparse.ArgumentTypeError(f"{file_of_camera(text)}: no such file")
    return text


def write_json(path, value):
    """At once, so that nobody ever reads half of it."""
    path = path.resolve()
    part = path.with_name(f"{path.name}.part")
    part.write_text(json.dumps(value, indent=1) + "\n")
    part.replace(path)


def binaries_of(build, *programs):
    """The folder bin/ of a build, which must hold these."""
    binaries = pathlib.Path(build) / "bin"
    for program in programs:
        if not (binaries / program).exists():
            refuse(f"{binaries / program}: not built; run deploy/build (see tests/bench/README.md) or pass --build")
    return binaries


def check_domains(first, count):
    """That there are so many DDS domains from there on."""
    if first + count - 1 > LAST_DOMAIN:
        refuse(f"--domain {first}: {count} domains are used and {LAST_DOMAIN} is the last there is")


def how_it_ended(command, code, said):
    """A program's exit code and why, in a line: of a usage error the first line it said, else the last."""
    lines = [line.strip() for line in said.splitlines() if line.strip()] or ["nothing said"]
    name = pathlib.Path(command[0]).name
    return f"{name} ended with {code}: {lines[0 if code == 2 else -1].removeprefix(f'{name}: ')}"


def run(command, log=None):
    """What a program says on stdout; what it says on stderr goes to the log, if there is one."""
    with open(log, "w+", errors="replace") if log else tempfile.TemporaryFile("w+", errors="replace") as stderr:
        try:
            done = subprocess.run([str(word) for word in command], stdout=subprocess.PIPE, stderr=stderr, text=True)
        except OSError as error:
            raise Failure(f"{command[0]}: {error.strerror}")
        stderr.seek(0)
        if done.returncode != 0:
            raise Failure(how_it_ended(command, done.returncode, stderr.read()))
    return done.stdout


class Sequence:
    """A recording, or a scenario that becomes one when it is rendered. `listing`: the file with a row for each frame."""

    def __init__(self, text, calibration):
        self.source = None
        self.listing = None
        self.truth = None
        self.calibration = None
        if text.startswith("sim:"):
            self.name = text
            return
        if text.startswith("images:"):
            folder = pathlib.Path(text.removeprefix("images:").partition("?")[0])
            if not folder.is_dir():
                refuse(f"{folder}: no such folder")
            self.name = folder.absolute().name
            self.source = text if "?" in text else f"{text}?fps=25"
            own = first_existing(folder, ["camera.txt"])
            self.calibration = own or calibration or self.camera_of_cube()
            return
        folder = pathlib.Path(text)
        if not folder.is_dir():
            refuse(f"{folder}: no such folder")
        self.name = folder.absolute().name
        if (folder / "rgb.txt").exists():
            self.source = f"tum:{folder}"
            self.listing = folder / "rgb.txt"
        elif (folder / "video.mp4").exists() and (folder / "times.txt").exists():
            self.source = f"video:{folder}/video.mp4?times={folder}/times.txt"
            self.listing = folder / "times.txt"
        else:
            refuse(f"{folder}: neither rgb.txt nor video.mp4 and times.txt")
        own = first_existing(folder, ["camera.txt", "camera-colmap.txt"])
        self.calibration = own or calibration or self.camera_of_cube()
        self.truth = first_existing(folder, ["groundtruth-colmap.txt", "groundtruth.txt"])

    def camera_of_cube(self):
        return CUBE_CAMERA if self.name in CUBE_NAMES else None


def first_existing(folder, names):
    return next((folder / name for name in names if (folder / name).exists()), None)


def limits_of(table, name):
    """Of a sequence, whatever options its name has; None: there are none."""
    return table.get(name.partition("?")[0])


def check_limits(table, names):
    """Says which sequences a --check looks at in vain, and refuses when it is all of them."""
    without = [name for name in dict.fromkeys(names) if limits_of(table, name) is None]
    for name in without:
        complain(f"no limits for {name}: nothing checked")
    if len(without) == len(set(names)):
        refuse(f"--check: there are limits for {', '.join(sorted(table))}")


def render_command(name, binaries, folder):
    """Of `sim:SCENARIO?KEY=VALUE&...`."""
    scenario, _, options = name.removeprefix("sim:").partition("?")
    command = [binaries / "cairn-sim", "render", scenario, "--out", folder]
    for option in filter(None, options.split("&")):
        key, _, value = option.partition("=")
        command += [f"--{key}", value]
    return command


def check_scenario(name, binaries):
    """Refuses what cairn-sim does not know, by one frame without an image."""
    with tempfile.TemporaryDirectory() as folder:
        command = render_command(name, binaries, folder)
        if "--frames" not in command:
            command += ["--frames", "1"]
        elif (frames := command[command.index("--frames") + 1]).isdecimal() and int(frames) > 0:
            command[command.index("--frames") + 1] = "1"
        try:
            run([*command, "--no-images"])
        except Failure as failure:
            refuse(f"{name}: {failure}")


def render(sequence, binaries, folder):
    """Renders a scenario as a TUM recording: images, calibration and exact truth."""
    run(render_command(sequence.name, binaries, folder / "sequence"), folder / "render.log")
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
        self.command = [str(word) for word in (binaries / "cairn-server", "--domain", domain, "--seed", seed, "--stats",
                                               folder / "server.json", *more)]
        self.log_file = folder / "server.log"
        self.log = open(self.log_file, "w")
        self.process = subprocess.Popen(self.command, stdout=subprocess.DEVNULL, stderr=self.log)

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
        try:
            return self.process.wait(timeout=STOP_DEADLINE_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            return self.process.wait()

    def how_it_ended(self):
        return how_it_ended(self.command, self.process.returncode, self.log_file.read_text(errors="replace"))


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
    """Likewise: what came of it came in time. A lost frame has no pose: it is late. Before there is a map none can have one, so these
    count by their time alone (as `on_time_share` of the stats' summary)."""
    return frame["state"] not in ("dropped", "lost") and frame["wall_ms"] <= ON_TIME_MS


def rows_of(path):
    """The fields of each row of a text file, without comments and blank lines."""
    return [line.split() for line in path.read_text().splitlines() if line.strip() and not line.startswith("#")]


def percentile(values, share):
    """The nearest rank; "-" of no values."""
    ranked = sorted(values)
    return ranked[max(0, math.ceil(share * len(ranked)) - 1)] if ranked else "-"
