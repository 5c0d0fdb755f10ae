#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Of the tables of FIGURES.md that a program writes."""
import pathlib
import subprocess
import unittest

import figure_tables

HERE = pathlib.Path(__file__).resolve().parent
ROWS = [{"readers": 0, "server_cores": 0.39, "readers_cores": 0, "server_peak_mb": 144.0, "verdict_p50_ms": 6.3, "verdict_p95_ms": 10.0,
         "keyframe_to_points_ms": {"p95": 33.3}},
        {"readers": 64, "server_cores": 0.5, "readers_cores": 0.8, "server_peak_mb": 200.0, "verdict_p50_ms": None, "verdict_p95_ms": 12.5,
         "keyframe_to_points_ms": {"p95": 66.7}}]


class FigureTables(unittest.TestCase):
    def test_each_table_of_the_page_is_that_of_its_figures(self):
        done = subprocess.run([HERE / "write-figures", "--check"], capture_output=True, text=True)
        self.assertEqual((done.returncode, done.stderr), (0, ""))

    def test_a_row_for_each_number_of_readers_and_nothing_where_nothing_was_measured(self):
        columns, rows = figure_tables.of_readers(ROWS)
        self.assertEqual(list(rows), ["0 readers", "64 readers"])
        table = figure_tables.render({"command": "run-readers", "columns": columns, "rows": rows})
        self.assertIn("| 64 readers | 0.500 | 0.800 | 200 | - | 12.5 | 66.7 |", table)

    def test_a_cell_says_by_how_much_it_is_another_than_the_time_before(self):
        self.assertEqual(figure_tables.cell(12.5, 10), "12.5 (+2.50)")
        self.assertEqual(figure_tables.cell(0.25, 0.5), "0.250 (-0.250)")
        self.assertEqual(figure_tables.cell(12.51, 12.52), "12.5")
        self.assertEqual(figure_tables.cell(3, None), "3")
        self.assertEqual(figure_tables.cell(None, 3), "-")

    def test_only_what_is_between_its_marks_is_replaced(self):
        begin, end = figure_tables.begin_and_end("flood")
        text = f"above\n{begin}\nold\n{end}\nbelow\n"
        self.assertEqual(figure_tables.replaced(text, "flood", "new"), text.replace("old", "new"))
        self.assertEqual(figure_tables.shown(text, "flood"), "old")
        for wrong in ("no marks", text + text, f"{end}\n{begin}"):
            with self.assertRaises(ValueError):
                figure_tables.replaced(wrong, "flood", "new")

    def test_a_median_is_of_all_runs_and_none_where_one_has_no_figure(self):
        runs = {"alone": [{"tracked": 3, "frame_cpu_ms": {"p50": value, "p95": 9}} for value in (1, 2, 8)], "flood": [{"tracked": 1, "frame_cpu_ms": None}]}
        columns, rows = figure_tables.of_kinds(runs, (("frame_cpu_ms", "a frame"),))
        self.assertEqual(columns, ["alone", "flood"])
        self.assertEqual(rows["a frame, p50, ms"], [2, None])


if __name__ == "__main__":
    unittest.main()
