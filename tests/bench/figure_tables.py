# SPDX-License-Identifier: Apache-2.0
"""The tables of FIGURES.md that a program writes: what each takes of its benchmark's --json, and how a table reads. Standard library only."""
import statistics


def median_of(rows, *path):
    """Of what is found by these keys in each row; None where one row has nothing there."""
    values = []
    for row in rows:
        for key in path:
            row = row.get(key) if row else None
        if row is None:
            return None
        values.append(row)
    return statistics.median(values)


def of_accuracy(results):
    """run-accuracy: each recording and pace, medians of its runs."""
    columns = ["runs", "map at frame", "tracked, %", "on time, %", "ATE, mm", "RPE over 1 s, mm", "CPU p50, ms", "CPU p99, ms", "CPU p50 by OpenCV's FAST",
               "before the map, CPU p95, ms", "points tried", "found", "keyframes", "points", "map, MB a keyframe", "server, MB a keyframe"]
    keys = ["first_map_frame", "tracked_percent", "on_time_percent", "ate_mm", "rpe_mm", "cpu_ms_p50", "cpu_ms_p99", "cpu_by_yardstick", "start_ms_p95",
            "attempted_p50", "found_p50", "keyframes", "points", "map_mb_per_keyframe", "server_mb_per_keyframe"]
    runs = {}
    for result in results:
        runs.setdefault(f"{result['sequence']}, {result['pace']}", []).append(result)
    return columns, {name: [len(rows), *(median_of(rows, key) for key in keys)] for name, rows in runs.items()}


def of_kinds(figures, whats):
    """Runs of several kinds by turns: a column a kind, a row for each figure and share, medians of the runs."""
    rows = {}
    for key, words in whats:
        for share in ("p50", "p95"):
            rows[f"{words}, {share}, ms"] = [median_of(runs, key, share) for runs in figures.values()]
    rows["frames tracked"] = [median_of(runs, "tracked") for runs in figures.values()]
    return list(figures), rows


WAITS = (("keyframe_to_points_ms", "keyframe taken to its points in the tracker's map"), ("offer_to_points_ms", "offer to the revision with its points, at the server"),
         ("frame_cpu_ms", "processor time of a tracked frame"))


def of_flood(figures):
    """run-flood."""
    columns, rows = of_kinds(figures, (*WAITS, ("frame_wall_ms", "a frame's pose after it was due")))
    rows["most memory of the server, MB"] = [median_of(runs, "server_peak_mb") for runs in figures.values()]
    return columns, rows


def of_security(figures):
    """run-security."""
    return of_kinds(figures, WAITS)


def of_readers(results):
    """run-readers: a row for each number of readers."""
    keys = {"server, cores": ("server_cores",), "readers, cores": ("readers_cores",), "server's peak, MB": ("server_peak_mb",),
            "verdict p50, ms": ("verdict_p50_ms",), "verdict p95, ms": ("verdict_p95_ms",),
            "keyframe to points p95, ms": ("keyframe_to_points_ms", "p95")}
    name = lambda row: f"{row['readers']} readers" + (f", niceness {row['nice']}" if row.get("nice") else "")
    return list(keys), {name(row): [median_of([row], *path) for path in keys.values()] for row in results}


def of_idle(results):
    """run-readers --idle."""
    return ["I/O thread, cores", "other threads, cores", "server's peak, MB"], {
        f"{row['idle']} idle clients": [row["io_thread_cores"], sum(row["other_threads_cores"].values()), row["server_peak_mb"]] for row in results}


def of_cameras(results):
    """run-cameras: a row for each number of cameras."""
    keys = {"frames within 33 ms, %": "good_percent", "of the worst tracker, %": "worst_percent", "frames dropped": "dropped", "CPU p50, ms": "cpu_ms_p50",
            "CPU p99, ms": "cpu_ms_p99", "other programs' CPU, %": "other_cpu_percent"}
    return list(keys), {f"{row['cameras']} cameras": [row.get(key) for key in keys.values()] for row in results}


def of_relock(jumps):
    """run-relock: all jumps."""
    found = sorted(jump["ms"] for jump in jumps if jump["right"])
    wrong = sum(jump["ms"] is not None and not jump["right"] for jump in jumps)
    at = lambda share: found[min(len(found) - 1, int(share * len(found)))] if found else None
    return ["jumps", "locked rightly", "in a wrong map", "p50, ms", "p95, ms", "most, ms"], {
        "jumps": [len(jumps), len(found), wrong, at(0.5), at(0.95), at(1)]}


def of_imu(figures):
    """run-imu: a row for each speed."""
    percent = lambda shares: 100 * statistics.fmean(shares)
    return ["tracked without a gyro, %", "with it, %"], {f"{row['speed']:g} times a calm hand": [percent(row["without"]), percent(row["with"])] for row in figures}


def of_rig(figures):
    """run-rig: a row for each case and frequency of steps."""
    return ["optical axis off, RMS, degrees", "at most, degrees", "frames tracked, %"], {
        f"{row['case']} at {row['hz']:g} Hz": [row["rms_deg"], row["worst_deg"], 100 * row["tracked"]] for row in figures["cases"]}


TABLES = {"accuracy": of_accuracy, "flood": of_flood, "security": of_security, "readers": of_readers, "idle": of_idle, "cameras": of_cameras, "relock": of_relock,
          "imu": of_imu, "rig": of_rig}


def number(value):
    """Three digits at least, and no more than tell something."""
    if value is None:
        return "-"
    if value == round(value) and abs(value) < 1e6:
        return str(round(value))
    return f"{value:.3f}" if abs(value) < 1 else f"{value:.2f}" if abs(value) < 10 else f"{value:.1f}"


def cell(now, before):
    """The figure and, where it is another than last time, by how much."""
    if now is None or before is None or number(now) == number(before):
        return number(now)
    sign = "+" if now > before else "-"
    return f"{number(now)} ({sign}{number(abs(now - before))})"


def render(kept):
    """Markdown of a table as it is kept: what it was made by, columns, rows now and before."""
    lines = [f"`{kept['command']}`; in brackets: by how much that is more or less than the time before.", "", f"| | {' | '.join(kept['columns'])} |",
             "|---" * (1 + len(kept["columns"])) + "|"]
    before = kept.get("before", {})
    for label, values in kept["rows"].items():
        old = before.get(label, [None] * len(values))
        lines.append(f"| {label} | {' | '.join(cell(now, then) for now, then in zip(values, old))} |")
    return "\n".join(lines)


def begin_and_end(name):
    return f"<!-- figures: {name} -->", f"<!-- end of {name} -->"


def replaced(text, name, table):
    """The text with this table between its marks; ValueError: it has none."""
    begin, end = begin_and_end(name)
    if text.count(begin) != 1 or text.count(end) != 1 or text.index(begin) > text.index(end):
        raise ValueError(f"there is no one place '{begin}' ... '{end}'")
    return text[:text.index(begin) + len(begin)] + "\n" + table + "\n" + text[text.index(end):]


def shown(text, name):
    """What stands between the marks of this table."""
    begin, end = begin_and_end(name)
    return text[text.index(begin) + len(begin):text.index(end)].strip("\n")
