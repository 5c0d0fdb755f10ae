# SPDX-License-Identifier: Apache-2.0
"""The tables of FIGURES.md: rows and columns of each, and what makes records of its benchmark's --json. Standard library only."""
import statistics

from figure_table import Column, Table, least, mean, median, most, ranked, total, value_at

METHODS = ("ours", "paper", "words", "words+geometry")
LIGHTS = ("as recorded", "gain 0.5", "gain 2", "bias -40", "bias +40", "gamma 0.5", "gamma 2")  # to_string of tests/bench/light.h


def count(records):
    return len(records)


def by_kind(figures):
    """Of runs of several kinds by turns."""
    return [{"kind": kind, **run} for kind, runs in figures.items() for run in runs]


def by_work(results):
    """Of run-accuracy: what the map maker does, with what is asked of it."""
    work = {"frame of a keyframe to its points at the tracker, ms (at p95 at most 150)": "keyframe_to_points_ms",
            "offer to when a query finds its keyframe, ms (at most 100)": "map_maker.offer_to_searchable_ms",
            "offer waited, ms (at most 20)": "map_maker.offer_waited_ms", "new points of a keyframe, CPU ms": "map_maker.new_points_cpu_ms",
            "local adjustment, CPU ms (at p95 at most 80)": "map_maker.local_adjustment_cpu_ms",
            "local adjustment, observations": "map_maker.local_adjustment_observations",
            "global adjustment, CPU ms (at most 1000)": "map_maker.global_adjustment_cpu_ms",
            "global adjustment, observations": "map_maker.global_adjustment_observations"}
    return [{"work": words, **(value_at(result, path) or {})} for words, path in work.items() for result in results]


def of_starts(results):
    return [{"sequence": row["sequence"], "starts": len(row["starts"]), "good": sum(start["good"] for start in row["starts"]),
             "waits": [start["frames"] for start in row["starts"] if start["frames"] is not None]} for row in results]


def of_holding(results):
    return [{**run, "never": sum(wait is None for wait in run.get("waits", [])), "waits": [wait for wait in run.get("waits", []) if wait is not None]}
            for run in results]


def of_visits(visits):
    """What became of visits to places that are mapped."""
    locks = [visit["frames_to_lock"] for visit in visits if visit["frames_to_lock"] is not None]
    return {"visits": len(visits), "locks": locks, "found": len(locks), "outside": sum(visit["outside"] for visit in visits)}


def of_locks(locks):
    """What became of locks to a place that is not in view."""
    wrong = [lock["frames"] for lock in locks if not lock["excused"]]
    return {"wrong_locks": len(wrong), "wrong_frames": sum(wrong), "held_too_long": len(locks) - len(wrong)}


def visits_to_mapped(verdict):
    return [visit for place in verdict["places"] if place["to_map"] for visit in place["visits"]]


def of_experiments(verdicts):
    return [{**verdict, **of_visits(visits_to_mapped(verdict)), **of_locks(verdict["wrong_locks"]), "labels": len(verdict["labels"]),
             "placed": sum(label["placed"] for label in verdict["labels"]),
             "degrees": None if verdict["labels_degrees"]["max"] == "-" else verdict["labels_degrees"]["max"]} for verdict in verdicts]


def of_cameras(verdicts):
    """A record for each camera of each run."""
    return [{"mapped_by": " and ".join(verdict["mapped_by"]), "camera": camera,
             **of_visits([visit for visit in visits_to_mapped(verdict) if visit["camera"] == camera]),
             **of_locks([lock for lock in verdict["wrong_locks"] if lock["camera"] == camera])}
            for verdict in verdicts for camera in dict.fromkeys(visit["camera"] for visit in visits_to_mapped(verdict))]


def of_maps(verdicts):
    """Of runs with --one-map and without."""
    return [{**verdict, **of_visits(visits_to_mapped(verdict)), **of_locks(verdict["wrong_locks"]),
             "maps": "one map" if verdict["one_map"] else "a map each", "keyframes": sum(made["keyframes"] for made in verdict["maps_made"]),
             "points": sum(made["points"] for made in verdict["maps_made"]),
             "drift": max((home["drift"] for made in verdict["maps"] for home in made["homes"]), default=None) if verdict["one_map"] else None}
            for verdict in verdicts]


def of_jumps(jumps):
    return [{**jump, "rights": [] if jump["right"] is None else [jump["right"]], "shown": [] if jump["published"] is None else [jump["published"]],
             "recovered": jump["right"] is not None} for jump in jumps]


def of_relocks(jumps):
    return [{**jump, "seconds": jump["dark"] / 30, "found": [jump["ms"]] if jump["right"] else [],
             "wrong": jump["ms"] is not None and not jump["right"]} for jump in jumps]


def of_seeds(results):
    return [{"seed": row["seed"], **light} for row in results for light in row["lights"]]


def of_index(figures):
    return [*figures["searches"], *figures["answers"]]


def of_adjustments(problems):
    return [{**problem, **solver, "name": problem["problem"].removesuffix(".txt"), "own": solver["solver"] == "own"} for problem in problems for solver in problem["solvers"]]


def of_found_cameras(results):
    return [{**run, "known": run["focal_error_percent"] is not None,
             "off": [] if run["focal_error_percent"] is None else [run["focal_error_percent"]]} for run in results]


def of_functions(figures):
    """Of google-benchmark: processor time, or what the benchmark itself took."""
    to_us = {"ns": 1e-3, "us": 1, "ms": 1e3, "s": 1e6}
    return [{"function": run["name"].removeprefix("BM_").removesuffix("/manual_time"),
             "us": run["real_time" if run["name"].endswith("/manual_time") else "cpu_time"] * to_us[run["time_unit"]]}
            for run in figures["benchmarks"]]


def of_walks(figures):
    """Of run-rig: how much less the optical axis is off than that of a fixed camera."""
    fixed = {row["hz"]: row["rms_deg"] for row in figures["cases"] if row["case"] == "fixed"}
    return [{**row, "tracked_percent": 100 * row["tracked"], "better": fixed[row["hz"]] / row["rms_deg"] if row["case"] == "lock" and row["hz"] in fixed else None}
            for row in figures["cases"]]


def of_searches(figures):
    return [{"bus": figures["bus"], "found": [row["seconds"]] if row["seconds"] is not None and not row["wrong"] else []} for row in figures["search"]]


def of_readers(results):
    return [{**row, "beside": f", niceness {row['nice']}" if row.get("nice") else ""} for row in results]


def of_idle(results):
    return [{**row, "others": sum(row["other_threads_cores"].values())} for row in results]


def sizes(path):
    """How many there are in lists."""
    return lambda records: sum(len(value_at(record, path)) for record in records)


def spread(words, path, *shares, unit="ms"):
    """A column for each share of what is measured; the median of runs."""
    return tuple(Column(f"{words}, {share}, {unit}", median(f"{path}.{share}")) for share in shares)


WAITS = (*spread("keyframe taken to its points in the tracker's map", "keyframe_to_points_ms", "p50", "p95"),
         *spread("offer to the revision with its points, at the server", "offer_to_points_ms", "p50", "p95"),
         *spread("processor time of a tracked frame", "frame_cpu_ms", "p50", "p95"))
LOCKS = (Column("visits", total("visits")), Column("found", total("found")), Column("in the outer map", total("outside")),
         Column("frames to lock p50", ranked("locks", 0.5)), Column("p95", ranked("locks", 0.95)), Column("most", ranked("locks", 1)),
         Column("wrong locks", total("wrong_locks")), Column("their frames", total("wrong_frames")), Column("held too long", total("held_too_long")))
PLACES_TIMES = (Column("by images, CPU ms p50", median("by_images.p50", method="ours"), 1), Column("p95", median("by_images.p95", method="ours"), 1),
                Column("with words, CPU ms p50", median("with_words.p50", method="ours"), 1), Column("p95", median("with_words.p95", method="ours"), 1))

TABLES = {
    "accuracy": Table("{sequence}, {pace}", (
        Column("runs", count), Column("map at frame", median("first_map_frame")), Column("tracked, %", median("tracked_percent")),
        Column("on time, %", median("on_time_percent")), Column("ATE, mm", median("ate_mm")), Column("RPE over 1 s, mm", median("rpe_mm")),
        Column("CPU p50, ms", median("cpu_ms_p50")), Column("CPU p99, ms", median("cpu_ms_p99")),
        Column("CPU p50 by OpenCV's FAST", median("cpu_by_yardstick")), Column("before the map, CPU p95, ms", median("start_ms_p95")),
        Column("points tried", median("attempted_p50")), Column("found", median("found_p50")), Column("keyframes", median("keyframes")),
        Column("points", median("points")), Column("map, MB a keyframe", median("map_mb_per_keyframe")),
        Column("server, MB a keyframe", median("server_mb_per_keyframe")))),
    "starts": Table("{sequence}", (
        Column("starts", total("starts")), Column("made", sizes("waits")), Column("good", total("good")),
        Column("frames to the start p50", ranked("waits", 0.5)), Column("p90", ranked("waits", 0.9))), of_starts),
    "hold": Table("{case}, {pace}", (
        Column("runs", count), Column("map at frame", median("map_at")), Column("held, %", median("held_percent"), 1),
        Column("least", least("held_percent"), 1), Column("of it rotation only", median("rotation_percent"), 1), Column("maps", median("maps")),
        Column("wrong poses", median("wrong")), Column("most", most("wrong")), Column("of", median("judged")),
        Column("losses in all runs", sizes("waits")), Column("without end", total("never")), Column("frames to the next pose p50", ranked("waits", 0.5)),
        Column("p95", ranked("waits", 0.95)), Column("CPU p50, ms", median("cpu_p50"), 1), Column("p99", median("cpu_p99"), 1)), of_holding),
    "experiments": Table("{experiment}, {method}", (
        Column("runs", count), *LOCKS, Column("named first at a visit", total("answers.first_named")), Column("not in view", total("answers.first_wrong")),
        Column("labels", total("labels")), Column("placed", total("placed")), Column("degrees off at most", most("degrees"), 1)), of_experiments),
    "visitors": Table("mapped by {mapped_by}, visited with {camera}", (Column("runs", count), *LOCKS), of_cameras),
    "one-map": Table("seed {seed}, {maps}", (
        Column("keyframes", median("keyframes")), Column("points", median("points")), Column("desks", median("to_map")), Column("mapped", median("mapped")),
        Column("largest drift, m", median("drift"), 3), *LOCKS, Column("server's CPU while mapping, s", median("server_cpu_s.mapping"), 1),
        Column("at the visits, s", median("server_cpu_s.visits"), 1)), of_maps),
    "reloc": Table("{sequence}, {method}", (
        Column("asked in view", total("in_view.asked")), Column("right", total("in_view.right")), Column("wrong", total("in_view.wrong")),
        Column("asked elsewhere", total("elsewhere.asked")), Column("answered", total("elsewhere.answered")), Column("right", total("elsewhere.right")),
        Column("wrong", total("elsewhere.wrong")), Column("CPU p50, ms", median("answer_ms.p50"), 1), Column("p95", median("answer_ms.p95"), 1))),
    "places": Table("{light}", (
        Column("in view", median("in_view", method="ours")), Column("ours: right", median("right", method="ours")),
        Column("wrong map", median("wrong_map", method="ours")), Column("wrong pose", median("wrong_pose", method="ours")),
        Column("claimed without the own map", median("claimed", method="ours")), Column("of", median("foreign", method="ours")),
        *(column for method in METHODS[1:] for column in (Column(f"{method}: right", median("right", method=method)),
                                                          Column("wrong map", median("wrong_map", method=method)))), *PLACES_TIMES),
        lambda figures: figures["lights"]),
    "look-alikes": Table("seed {seed}", (
        Column("in view", median("in_view", method="ours")), *(Column(f"right: {light}" if light == LIGHTS[0] else light, median("right", light=light)) for light in LIGHTS),
        Column("wrong map", total("wrong_map")), Column("wrong pose", total("wrong_pose")), Column("claimed without the own map", total("claimed")),
        *PLACES_TIMES), of_seeds),
    "index": Table("{keyframes}", (
        Column("all tiny images, µs p50", median("us_p50", search="all tiny images"), 0),
        Column("scan of compact images", median("us_p50", search="scan of compact images"), 0), Column("forest", median("us_p50", search="forest"), 0),
        *(Column(words, median(f"recall_{where}", search=search), 3)
          for search, ten in (("forest", "the ten nearest"), ("forest, for the fused order", "the 128 fused"))
          for where, words in (("mapped", f"recall of {ten}, mapped"), ("elsewhere", "elsewhere"))),
        Column("query by images, ms p50", median("by_images.p50", search="queries by the forest"), 1), Column("p95", median("by_images.p95", search="queries by the forest"), 1),
        Column("with words, ms p50", median("with_words.p50", search="queries by the forest"), 1), Column("p95", median("with_words.p95", search="queries by the forest"), 1),
        Column("right", median("right", search="queries by the forest")), Column("of", median("asked", search="queries by the forest"))), of_index),
    "relock": Table("dark for {seconds:.1f} s", (
        Column("jumps", count), Column("locked rightly", sizes("found")), Column("in a wrong map", total("wrong")), Column("p50, ms", ranked("found", 0.5), 0),
        Column("p95, ms", ranked("found", 0.95), 0), Column("most, ms", ranked("found", 1), 0)), of_relocks),
    "jumps": Table("to {place}", (
        Column("jumps", count), Column("recovered", total("recovered")), Column("frames to a right pose p50", ranked("rights", 0.5)),
        Column("most", ranked("rights", 1)), Column("to one that is shown p50", ranked("shown", 0.5)), Column("most", ranked("shown", 1)),
        Column("frames in a wrong map", total("wrong_map")), Column("with a wrong pose", total("wrong_pose")), Column("without a pose", total("without"))),
        of_jumps),
    "map-maker": Table("{work}", tuple(Column(share, median(share)) for share in ("p50", "p95", "p99")), by_work),
    "adjustment": Table("{name}", (
        Column("poses", median("poses")), Column("points", median("points")), Column("observations", median("observations")),
        Column("to 1 %: own, ms", median("ms_to_goal", own=True), 1), Column("iterations", median("iterations_to_goal", own=True)),
        Column("Ceres, best, ms", least("ms_to_goal", own=False), 1), Column("as asked: own, ms", median("ms", own=True), 1),
        Column("iterations", median("iterations", own=True)), Column("Ceres, best, ms", least("ms", own=False), 1),
        Column("between polls at most, ms", median("longest_poll_ms", own=True), 1)), of_adjustments),
    "self-calibration": Table("{sequence}", (
        Column("runs", count), Column("known in the end", total("known")), Column("focal length off, %, median of these", ranked("off", 0.5), 2),
        Column("at most, %", ranked("off", 1), 2)), of_found_cameras),
    "cameras": Table("{cameras} cameras", tuple(Column(heading, median(key)) for heading, key in (
        ("frames within 33 ms, %", "good_percent"), ("of the worst tracker, %", "worst_percent"), ("frames dropped", "dropped"),
        ("CPU p50, ms", "cpu_ms_p50"), ("CPU p99, ms", "cpu_ms_p99"), ("other programs' CPU, %", "other_cpu_percent")))),
    "micro": Table("{function}", (Column("µs", median("us")),), of_functions),
    "growth": Table("from {wanted} on", (
        Column("points", median("points")), Column("tried", median("attempted.p50")), Column("found", median("found.p50")), Column("CPU p50, ms", median("cpu_ms.p50"), 2),
        Column("p95", median("cpu_ms.p95"), 2), Column("p99", median("cpu_ms.p99"), 2), Column("of it projection, p50", median("project_ms.p50"), 2))),
    "instructions": Table("{machine}", (Column("million instructions a frame", median("millions"), 2),),
                          lambda counts: [{"machine": machine, "millions": counted / 1e6} for machine, counted in counts.items()]),
    "rig": Table("{case} at {hz:g} Hz", (
        Column("optical axis off, RMS, degrees", median("rms_deg"), 2), Column("at most, degrees", median("worst_deg"), 2),
        Column("times better than fixed", median("better"), 1), Column("frames tracked, %", median("tracked_percent"), 1)), of_walks),
    "rig-search": Table("{bus}", (
        Column("searches", count), Column("found, with right poses only", sizes("found")), Column("p50, s", ranked("found", 0.5), 2),
        Column("most, s", ranked("found", 1), 2)), of_searches),
    "rig-stop": Table("{bus}", (
        Column("times", sizes("stop_ms")), Column("key to idle drives p50, ms", ranked("stop_ms", 0.5), 0), Column("most, ms", ranked("stop_ms", 1), 0)),
        lambda figures: [figures]),
    "rig-calibration": Table("{bus}", (
        Column("camera off, degrees", median("calibrate.camera"), 2), Column("IMU off, degrees", median("calibrate.imu"), 2),
        Column("clocks' offset off, ms", median("calibrate.offset"), 1)), lambda figures: [figures]),
    "imu": Table("{speed:g} times a calm hand", (
        Column("tracked without a gyro, %", mean("without"), 1), Column("with it, %", mean("with"), 1)),
        lambda rows: [{"speed": row["speed"], **{key: 100 * statistics.fmean(row[key]) for key in ("without", "with")}} for row in rows]),
    "security": Table("{kind}", (*WAITS, Column("frames tracked", median("tracked"))), by_kind, turned=True),
    "flood": Table("{kind}", (
        *WAITS, *spread("a frame's pose after it was due", "frame_wall_ms", "p50", "p95"), Column("frames tracked", median("tracked")),
        Column("most memory of the server, MB", median("server_peak_mb"))), by_kind, turned=True),
    "readers": Table("{readers} readers{beside}", (
        Column("server, cores", median("server_cores")), Column("readers, cores", median("readers_cores")), Column("server's peak, MB", median("server_peak_mb")),
        Column("verdict p50, ms", median("verdict_p50_ms")), Column("verdict p95, ms", median("verdict_p95_ms")),
        Column("keyframe to points p95, ms", median("keyframe_to_points_ms.p95"))), of_readers),
    "idle": Table("{idle} idle clients", (
        Column("I/O thread, cores", median("io_thread_cores")), Column("other threads, cores", median("others")),
        Column("server's peak, MB", median("server_peak_mb"))), of_idle),
}
