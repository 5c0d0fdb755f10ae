# SPDX-License-Identifier: Apache-2.0
"""What a table of FIGURES.md is, and how it reads: rows and columns of a benchmark's --json. Standard library only.

A benchmark writes records: one dictionary a run, a visit or whatever it repeats. The records that a table's `row` gives the same label make
one row, and each column makes one number of them.
"""
import dataclasses
import re
import statistics
from collections.abc import Callable

from playing import percentile

TAKEN_OVER = " \\*"  # behind the label of a row that an earlier page had and no --json has yet


@dataclasses.dataclass(frozen=True)
class Column:
    """`heading`: with the unit; `figure`: of the records of a row, None where nothing was measured; `digits`: after the point, None: so many
    that three tell something."""
    heading: str
    figure: Callable
    digits: int | None = None


@dataclasses.dataclass(frozen=True)
class Table:
    """`row`: the label of a record's row, from its keys; `records`: makes records of what the benchmark wrote; `turned`: a column for each
    label and a row for each figure."""
    row: str
    columns: tuple
    records: Callable = list
    turned: bool = False

    def figures(self, written):
        """Column headings, and the numbers of each row by its label."""
        groups = {}
        for record in self.records(written):
            groups.setdefault(self.row.format_map(record), []).append(record)
        headings = [column.heading for column in self.columns]
        rows = {label: [column.figure(group) for column in self.columns] for label, group in groups.items()}
        if self.turned:
            return list(rows), dict(zip(headings, map(list, zip(*rows.values()))))
        return headings, rows

    def digits(self, label, count):
        """Of each cell of a row."""
        if self.turned:
            return [next((column.digits for column in self.columns if column.heading == label), None)] * count
        return [column.digits for column in self.columns]


def value_at(record, path):
    """What is found by these keys, with points between them; None: nothing is there."""
    for key in path.split("."):
        record = record.get(key) if record else None
    return record


def figure_of(reduce, path, where):
    """Makes one number of what is found in each record that has these values; None where one has nothing."""
    def figure(records):
        values = [value_at(record, path) for record in records if all(record.get(key) == value for key, value in where.items())]
        return None if not values or None in values else reduce(values)
    return figure


def median(path, **where):
    return figure_of(statistics.median, path, where)


def mean(path, **where):
    return figure_of(statistics.fmean, path, where)


def least(path, **where):
    return figure_of(min, path, where)


def most(path, **where):
    return figure_of(max, path, where)


def total(path, **where):
    return figure_of(sum, path, where)


def ranked(path, share):
    """The nearest rank of all values in the lists that are found; None where there are none."""
    def reduce(lists):
        values = [value for values in lists for value in values]
        return percentile(values, share) if values else None
    return figure_of(reduce, path, {})


def number(value, digits=None):
    """Without `digits`: three at least, and no more than tell something."""
    if value is None:
        return "-"
    if digits is not None:
        return f"{value:.{digits}f}"
    if value == round(value) and abs(value) < 1e6:
        return str(round(value))
    return f"{value:.3f}" if abs(value) < 1 else f"{value:.2f}" if abs(value) < 10 else f"{value:.1f}"


def cell(now, before, digits=None):
    """The figure and, where it is another than last time, by how much."""
    if now is None or before is None or number(now, digits) == number(before, digits):
        return number(now, digits)
    sign = "+" if now > before else "-"
    difference = abs(float(number(now, digits)) - float(number(before, digits)))  # of what is printed
    return f"{number(now, digits)} ({sign}{number(difference, digits)})"


def render(table, kept):
    """Markdown of a table as it is kept: the command, columns, rows now and before, and which rows were taken over. ValueError: its columns
    are others."""
    if not table.turned and kept["columns"] != [column.heading for column in table.columns]:
        raise ValueError("its figures have other columns; play its benchmark again")
    lines = [f"`{kept['command']}`", "", f"| | {' | '.join(kept['columns'])} |", "|---" * (1 + len(kept["columns"])) + "|"]
    before = kept.get("before", {})
    for label, values in kept["rows"].items():
        old = before.get(label, [None] * len(values))
        cells = [cell(*of_one) for of_one in zip(values, old, table.digits(label, len(values)), strict=True)]
        lines.append(f"| {label}{TAKEN_OVER if label in kept.get('taken_over', []) else ''} | {' | '.join(cells)} |")
    return "\n".join(lines)


def merged(kept, columns, rows, command, turned=False):
    """The new rows in the place of the old ones, which become those of the time before; ValueError: there is no command, or a column, of
    what was played, would be lost."""
    lost = [column for column in kept.get("columns", []) if column not in columns]
    if turned and lost:
        raise ValueError(f"nothing was played for its column '{lost[0]}'; play all in one run, or remove figures/ of it to begin it anew")
    if kept and kept["columns"] != columns:
        kept = {"command": kept["command"]}  # another table: nothing to compare with
    if not (command or kept.get("command")):
        raise ValueError("--command is needed for a table that was never written")
    before = kept.get("before", {}) | {label: kept["rows"][label] for label in rows if label in kept.get("rows", {})}
    taken_over = [label for label in kept.get("taken_over", []) if label not in rows]
    return {"command": command or kept["command"], "columns": columns, "rows": kept.get("rows", {}) | rows, "before": before,
            **({"taken_over": taken_over} if taken_over else {})}


def begin_and_end(name):
    return f"<!-- figures: {name} -->", f"<!-- end of {name} -->"


def replaced(text, name, table):
    """The text with this table between its marks; ValueError: it has none."""
    begin, end = begin_and_end(name)
    if text.count(begin) != 1 or text.count(end) != 1 or text.index(begin) > text.index(end):
        raise ValueError(f"there is no one place '{begin}' ... '{end}'")
    return text[:text.index(begin) + len(begin)] + "\n" + table + "\n" + text[text.index(end):]


def rows_typed_by_hand(text):
    """The rows of tables that stand between no marks."""
    outside = re.sub(r"<!-- figures: (\S+) -->.*?<!-- end of \1 -->", "", text, flags=re.DOTALL)
    return [line for line in outside.splitlines() if line.lstrip().startswith("|")]
