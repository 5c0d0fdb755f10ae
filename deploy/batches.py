#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Which files of a target can be compiled as one (a file that includes them).

Most of a compiler's time goes into headers, so twenty files compiled as one take a third of it. Files that define the same
name, each in its own anonymous namespace, cannot go together, nor can one that uses a name of another namespace with one that
defines it. What a file defines is told by how lines begin at the level of a namespace.

Usage: deploy/batches.py SIZE FILE...     prints the batch's number and the file, a line for each file
"""

import pathlib
import re
import sys


def names_of(path):
    """What may be defined at the level of a namespace, by how such lines begin, and what is used there from another one.

    A function is `name`, or `name(Class` after the class of its first argument.
    """
    text = re.sub(r" = ", "=", path.read_text())
    text = re.sub(r"^template[^;{]*?(?=\()", lambda line: re.sub(r"\s+", " ", line[0]) + "(", text, flags=re.M)  # has no such class
    defined = re.findall(r"^(?:class|struct|enum class|enum) (\w+)|^using (\w+)=", text, re.M)
    defined = [a or b for a, b in defined]
    # The same alias of a namespace in two files is no second definition.
    for name, argument in re.findall(r"^(?!using |namespace )[A-Za-z][^\n(={;]*?(?<!:)\b(\w+)(?:\[\w*\])*[({=;]"
                                     r"((?<=\()(?:const )?(?:\w+::)*[A-Z]\w+[ &*]|)", text, re.M):
        defined.append(name + "(" + re.search(r"(\w+).?$", argument)[1] if argument else name)
    for enumerators in re.findall(r"^enum(?! class)[^{;]*{([^}]*)}", text, re.M):
        defined += re.findall(r"\b(k\w+)", enumerators)
    used = re.findall(r"^using (?:\w*::)+(\w+);", text, re.M)
    return set(defined) - {"TEST", "TEST_F", "TEST_P", "INSTANTIATE_TEST_SUITE_P"}, set(used)


def in_conflict(one, other):
    """Whether both define a name; of functions that differ in the class of the first argument, none."""
    functions, others = ({name.split("(")[0] for name in names if "(" in name} for names in (one, other))
    return bool(one & other or functions & other or others & one)


def that_go_together(paths, size):
    """Batches of at most `size` files each, in the order of `paths`."""
    batches = []
    for path in paths:
        defined, used = names_of(path)
        fit = next((b for b in batches if len(b[0]) < size and not in_conflict(b[1], defined)
                    and not in_conflict(b[1], used) and not in_conflict(b[2], defined)), None)
        if fit is None:
            fit = ([], set(), set())
            batches.append(fit)
        fit[0].append(path)
        fit[1].update(defined)
        fit[2].update(used)
    return [paths for paths, _, _ in batches]


def main():
    if len(sys.argv) < 3 or sys.argv[1] in ("-h", "--help"):
        print(__doc__)
        return 0 if len(sys.argv) > 1 and sys.argv[1] in ("-h", "--help") else 2
    for number, batch in enumerate(that_go_together([pathlib.Path(name) for name in sys.argv[2:]], int(sys.argv[1]))):
        for path in batch:
            print(f"{number} {path}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
