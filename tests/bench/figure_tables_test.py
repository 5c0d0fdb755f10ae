#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Of the tables of FIGURES.md: each is made from a benchmark's --json and from nothing else."""
import copy
import json
import pathlib
import re
import shutil
import subprocess
import tempfile
import unittest

from figure_table import TAKEN_OVER, Column, Table, begin_and_end, cell, median, merged, number, ranked, render, replaced, rows_typed_by_hand
from figure_tables import LIGHTS, METHODS, TABLES, WAITS

HERE = pathlib.Path(__file__).resolve().parent
SPREAD = {"count": 9, "p50": 1.25, "p95": 2.5, "p99": 3.75}
RUN = {"keyframe_to_points_ms": SPREAD, "offer_to_points_ms": SPREAD, "frame_cpu_ms": SPREAD, "frame_wall_ms": SPREAD, "tracked": 80, "server_peak_mb": 140}
LOCK = {"excused": False, "frames": 3, "camera": "hand"}
VISIT = {"frames_to_lock": 2, "outside": False, "camera": "hand"}
VERDICT = {"experiment": "desk", "method": "improved", "seed": 1, "mapped_by": ["hand"], "one_map": True, "mapped": 1, "to_map": 1, "server_cpu_s": {"mapping": 9, "visits": 2},
           "places": [{"to_map": True, "visits": [VISIT]}], "wrong_locks": [LOCK], "labels": [{"placed": True}], "labels_degrees": {"max": 1.5},
           "answers": {"first_named": 5, "first_wrong": 1}, "maps_made": [{"keyframes": 20, "points": 900}], "maps": [{"homes": [{"drift": 0.25}]}]}
LIGHT = {"in_view": 9, "right": 8, "wrong_map": 1, "wrong_pose": 1, "claimed": 1, "foreign": 12, "by_images": SPREAD, "with_words": SPREAD}
ASKED = dict.fromkeys(("asked", "answered", "right", "wrong"), 4)
ACCURACY = dict.fromkeys(("first_map_frame", "tracked_percent", "on_time_percent", "ate_mm", "rpe_mm", "cpu_ms_p50", "cpu_ms_p99", "cpu_by_yardstick", "start_ms_p95", "attempted_p50",
                          "found_p50", "keyframes", "points", "map_mb_per_keyframe", "server_mb_per_keyframe", "focal_error_percent"), 7)
# What each benchmark writes, as small as it gets.
WRITTEN = {
    "accuracy": [{"sequence": "xyz", "pace": "realtime", **ACCURACY}],
    "starts": [{"sequence": "xyz", "starts": [{"good": True, "frames": 6}, {"good": False, "frames": None}]}],
    "hold": [{"case": "pan", "pace": "lockstep", "waits": [3, None], **dict.fromkeys(
        ("map_at", "held_percent", "rotation_percent", "maps", "wrong", "judged", "cpu_p50", "cpu_p99"), 5)}],
    "experiments": [VERDICT], "visitors": [VERDICT], "one-map": [VERDICT],
    "reloc": [{"sequence": "xyz", "method": "paper", "in_view": ASKED, "elsewhere": ASKED, "answer_ms": SPREAD}],
    "places": {"lights": [{"method": method, "light": light, **LIGHT} for method in METHODS for light in LIGHTS]},
    "look-alikes": [{"seed": 21, "lights": [{"method": "ours", "light": light, **LIGHT} for light in LIGHTS]}],
    "index": {"searches": [{"keyframes": 1000, "search": search, "us_p50": 9, "recall_mapped": 1, "recall_elsewhere": 0.5}
                           for search in ("all tiny images", "scan of compact images", "forest", "forest, for the fused order")],
              "answers": [{"keyframes": 1000, "search": "queries by the forest", "right": 5, "asked": 6, "by_images": SPREAD, "with_words": SPREAD}]},
    "relock": [{"dark": 80, "ms": 136.5, "right": True}, {"dark": 80, "ms": 200.5, "right": False}, {"dark": 80, "ms": None, "right": False}],
    "jumps": [{"place": "xyz", "right": 1, "published": 3, "wrong_map": 0, "wrong_pose": 0, "without": 2}],
    "map-maker": [{"keyframe_to_points_ms": SPREAD, "map_maker": dict.fromkeys(
        ("offer_to_searchable_ms", "offer_waited_ms", "new_points_cpu_ms", "local_adjustment_cpu_ms", "local_adjustment_observations", "global_adjustment_cpu_ms",
         "global_adjustment_observations"), SPREAD)}],
    "adjustment": [{"problem": "desk.txt", "poses": 3, "points": 40, "observations": 99, "solvers": [
        {"solver": solver, "iterations_to_goal": 2, "ms_to_goal": 5.5, "iterations": 9, "ms": 20, "longest_poll_ms": 1} for solver in ("own", "ceres dense", "ceres sparse")]}],
    "self-calibration": [{"sequence": "xyz", "focal_error_percent": error} for error in (0.5, None)],
    "cameras": [{"cameras": 12, **dict.fromkeys(("good_percent", "worst_percent", "dropped", "cpu_ms_p50", "cpu_ms_p99", "other_cpu_percent"), 1)}],
    "micro": {"benchmarks": [{"name": "BM_Pyramid", "real_time": 9e9, "cpu_time": 11500.0, "time_unit": "ns"},
                             {"name": "BM_NewPoints/manual_time", "real_time": 2.5, "cpu_time": 9e9, "time_unit": "ms"}]},
    "growth": [{"wanted": 3000, "points": 3040, "attempted": SPREAD, "found": SPREAD, "cpu_ms": SPREAD, "project_ms": SPREAD}],
    "instructions": {"x86-64": 12e6, "arm64": 15e6},
    "rig": {"cases": [{"case": case, "hz": 1.5, "rms_deg": off, "worst_deg": 9, "tracked": 1} for case, off in (("lock", 0.5), ("fixed", 8))]},
    "rig-search": {"bus": "vcan0", "search": [{"seconds": 2.5, "wrong": 0}, {"seconds": 1.5, "wrong": 3}, {"seconds": None, "wrong": 0}]},
    "rig-stop": {"bus": "vcan0", "stop_ms": [10, 12]}, "rig-calibration": {"bus": "vcan0", "calibrate": {"camera": 0.1, "imu": 0.2, "offset": 2}},
    "imu": [{"speed": 8.0, "without": [0.9, 1.0], "with": [1.0, 1.0]}],
    "security": {"open": [RUN], "secured": [RUN]}, "flood": {"alone": [RUN], "beside one more": [RUN], "beside the flood": [RUN, RUN]},
    "readers": [{"readers": 64, "nice": nice, "server_cores": 0.5, "readers_cores": 0.75, "server_peak_mb": 200, "verdict_p50_ms": 1, "verdict_p95_ms": 12.5,
                 "keyframe_to_points_ms": SPREAD} for nice in (0, 19)],
    "idle": [{"idle": 256, "io_thread_cores": 0.25, "other_threads_cores": {"a": 0.5, "b": 0.25}, "server_peak_mb": 96}],
}


def rows_of(name, written=None):
    return TABLES[name].figures(copy.deepcopy(WRITTEN[name] if written is None else written))[1]


def value(name, label, heading):
    columns, rows = TABLES[name].figures(copy.deepcopy(WRITTEN[name]))
    return rows[label][columns.index(heading)]


class Tables(unittest.TestCase):
    def test_every_table_has_a_number_in_every_cell_of_what_its_benchmark_writes(self):
        self.assertEqual(set(WRITTEN), set(TABLES))
        empty = {"adjustment": [], "rig": ["times better than fixed"]}  # of lock alone
        for name, table in TABLES.items():
            columns, rows = table.figures(copy.deepcopy(WRITTEN[name]))
            self.assertTrue(rows, name)
            for label, values in rows.items():
                missing = [columns[i] for i, figure in enumerate(values) if figure is None and columns[i] not in empty.get(name, [])]
                self.assertEqual((name, label, missing), (name, label, []))
            text = render(table, {"command": "x", "columns": columns, "rows": rows})
            self.assertEqual({line.count("|") for line in text.splitlines()[2:]}, {len(columns) + 2}, name)

    def test_records_with_the_same_label_are_one_row(self):
        self.assertEqual(len(rows_of("accuracy", WRITTEN["accuracy"] * 3)), 1)
        self.assertEqual(rows_of("accuracy", WRITTEN["accuracy"] * 3)["xyz, realtime"][0], 3)
        self.assertEqual(list(rows_of("readers")), ["64 readers", "64 readers, niceness 19"])

    def test_a_turned_table_has_a_column_for_each_kind(self):
        columns, rows = TABLES["flood"].figures(WRITTEN["flood"])
        self.assertEqual(columns, ["alone", "beside one more", "beside the flood"])
        self.assertEqual(list(rows)[:len(WAITS)], [column.heading for column in WAITS])

    def test_what_was_not_found_is_in_no_median_and_counted(self):
        self.assertEqual(rows_of("relock")["dark for 2.7 s"], [3, 1, 1, 136.5, 136.5, 136.5])
        self.assertEqual(rows_of("rig-search")["vcan0"], [3, 1, 2.5, 2.5])
        self.assertEqual(rows_of("self-calibration")["xyz"], [2, 1, 0.5, 0.5])
        self.assertEqual(rows_of("starts")["xyz"][:3], [2, 1, 1])
        self.assertEqual((value("hold", "pan, lockstep", "losses in all runs"), value("hold", "pan, lockstep", "without end")), (1, 1))

    def test_figures_that_are_made_of_others(self):
        self.assertEqual(value("rig", "lock at 1.5 Hz", "times better than fixed"), 16)
        self.assertEqual(rows_of("micro"), {"Pyramid": [11.5], "NewPoints": [2500]})
        self.assertEqual(rows_of("idle")["256 idle clients"][1], 0.75)
        self.assertEqual(rows_of("imu")["8 times a calm hand"], [95, 100])
        self.assertEqual(value("one-map", "seed 1, one map", "largest drift, m"), 0.25)


class Cells(unittest.TestCase):
    def test_digits_are_three_at_least_or_as_the_column_says(self):
        self.assertEqual([number(x) for x in (None, 3, 3816.5, 0.25, 9.5, 42.25)], ["-", "3", "3816.5", "0.250", "9.50", "42.2"])
        self.assertEqual([number(x, 1) for x in (None, 3, 0.25, 97.96)], ["-", "3.0", "0.2", "98.0"])
        table = Table("{name}", (Column("a, ms", median("a"), 1), Column("b", median("b"))))
        columns, rows = table.figures([{"name": "x", "a": 2, "b": 0.5}])
        self.assertIn("| x | 2.0 | 0.500 |", render(table, {"command": "c", "columns": columns, "rows": rows}))

    def test_a_cell_says_by_how_much_it_is_another_than_the_time_before(self):
        self.assertEqual(cell(12.5, 10), "12.5 (+2.50)")
        self.assertEqual(cell(0.25, 0.5), "0.250 (-0.250)")
        self.assertEqual(cell(12.51, 12.52), "12.5")
        self.assertEqual(cell(3, None), "3")
        self.assertEqual(cell(None, 3), "-")
        self.assertEqual(cell(2.04, 2.01, 1), "2.0")

    def test_a_figure_is_of_all_records_and_none_where_one_has_none(self):
        records = [{"a": {"b": 1}, "kind": "x"}, {"a": {"b": 2}, "kind": "x"}, {"a": {"b": 9}, "kind": "y"}, {"a": None, "kind": "z"}]
        self.assertEqual(median("a.b")(records[:3]), 2)
        self.assertEqual(median("a.b", kind="x")(records), 1.5)
        self.assertIsNone(median("a.b")(records))
        self.assertIsNone(median("a.b", kind="none")(records))
        self.assertEqual(ranked("w", 0.95)([{"w": [3, 1]}, {"w": []}, {"w": [2]}]), 3)
        self.assertIsNone(ranked("w", 0.5)([{"w": []}]))


class Keeping(unittest.TestCase):
    OLD = {"command": "run-x", "columns": ["a"], "rows": {"one": [1], "two": [2]}, "before": {}, "taken_over": ["one", "two"]}

    def test_new_rows_take_the_place_of_old_ones_and_others_stay(self):
        new = merged(self.OLD, ["a"], {"two": [5], "three": [3]}, None)
        self.assertEqual((new["command"], new["rows"], new["before"]), ("run-x", {"one": [1], "two": [5], "three": [3]}, {"two": [2]}))
        self.assertEqual(new["taken_over"], ["one"])
        self.assertNotIn("taken_over", merged(new, ["a"], {"one": [1]}, None))
        table = Table("{n}", (Column("a", median("a")),))
        self.assertIn(f"| one{TAKEN_OVER} | 1 |\n| two | 5 (+3) |\n| three | 3 |", render(table, new))

    def test_other_columns_are_another_table(self):
        self.assertEqual(merged(self.OLD, ["b"], {"one": [7]}, "run-y"), {"command": "run-y", "columns": ["b"], "rows": {"one": [7]}, "before": {}})
        with self.assertRaises(ValueError):
            render(Table("{n}", (Column("b", median("b")),)), self.OLD)
        with self.assertRaises(ValueError):
            merged({}, ["a"], {"one": [1]}, None)

    def test_a_turned_table_loses_no_column(self):
        kept = {"command": "run-x", "columns": ["alone", "beside"], "rows": {"p50": [1, 2]}}
        with self.assertRaisesRegex(ValueError, "nothing was played for its column 'beside'"):
            merged(kept, ["alone", "other"], {"p50": [1, 3]}, None, turned=True)
        self.assertEqual(merged(kept, ["alone", "beside"], {"p50": [1, 3]}, None, turned=True)["before"], {"p50": [1, 2]})

    def test_only_what_is_between_its_marks_is_replaced(self):
        begin, end = begin_and_end("flood")
        text = f"above\n{begin}\nold\n{end}\nbelow\n"
        self.assertEqual(replaced(text, "flood", "new"), text.replace("old", "new"))
        for wrong in ("no marks", text + text, f"{end}\n{begin}"):
            with self.assertRaises(ValueError):
                replaced(wrong, "flood", "new")

    def test_a_row_outside_all_marks_is_typed_by_hand(self):
        begin, end = begin_and_end("flood")
        self.assertEqual(rows_typed_by_hand(f"text | text\n{begin}\n| a | 1 |\n{end}\n"), [])
        self.assertEqual(rows_typed_by_hand(f"{begin}\n| a | 1 |\n{end}\n | b | 2 |\n"), [" | b | 2 |"])


class Page(unittest.TestCase):
    """write-figures on a copy of the page."""

    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        for name in ("write-figures", "FIGURES.md", "figure_table.py", "figure_tables.py", "playing.py"):
            shutil.copy(HERE / name, self.folder)
        shutil.copytree(HERE / "figures", self.folder / "figures")
        self.page = self.folder / "FIGURES.md"

    def write_figures(self, *words):
        """Exit code, and what it says on stderr."""
        done = subprocess.run([self.folder / "write-figures", *words], capture_output=True, text=True)
        return done.returncode, done.stderr

    def written(self, name):
        path = self.folder / "written.json"
        path.write_text(json.dumps(WRITTEN[name]))
        return path

    def test_each_table_of_the_page_is_that_of_its_figures(self):
        done = subprocess.run([HERE / "write-figures", "--check"], capture_output=True, text=True)
        self.assertEqual((done.returncode, done.stderr), (0, ""))

    def test_every_table_can_be_written_and_then_holds(self):
        for name in TABLES:
            self.assertEqual(self.write_figures(name, self.written(name), "--command", f"played for {name}"), (0, ""), name)
            self.assertIn(f"`played for {name}`", self.page.read_text())
        self.assertEqual(self.write_figures("--check"), (0, ""))

    def test_what_is_typed_by_hand_is_found(self):
        right = self.page.read_text()
        row = next(line for line in right.splitlines() if re.match(r"\| .*\d", line))
        for wrong in (right.replace(row, row + " 7 |"), right.replace(row, ""), right + "\n| typed | 7 |\n", right.replace("<!-- end of idle -->", "")):
            self.page.write_text(wrong)
            code, said = self.write_figures("--check")
            self.assertEqual(code, 1, said)
        self.assertEqual(self.write_figures("--remake")[0], 1)  # the mark is missing
        self.page.write_text(right.replace(row, row + " 7 |"))
        self.assertEqual(self.write_figures("--remake"), (0, ""))
        self.assertEqual(self.page.read_text(), right)

    def test_what_no_benchmark_has_written_is_refused(self):
        right = self.page.read_text()
        path = self.folder / "wrong.json"
        for text in ("", "[1]", '[{"sequence": "x"}]'):
            path.write_text(text)
            code, said = self.write_figures("accuracy", path)
            self.assertEqual((code, said.count("\n")), (1, 1), said)
        self.assertEqual(self.page.read_text(), right)


if __name__ == "__main__":
    unittest.main()
