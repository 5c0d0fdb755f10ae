#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The texts of the project lead somewhere: every test that a README names is there, and so is what its links point to.
Names in sources are the glossary's (common/README.md): those that it replaced do not come back. Nobody drops a Result unseen.

Usage: texts_test.py
"""

import fnmatch
import os
import pathlib
import re
import unittest

ROOT = pathlib.Path(__file__).resolve().parents[2]
GTEST = re.compile(r"\b(?:TYPED_)?TEST(?:_F|_P)?\(\s*(\w+)\s*,\s*(\w+)\s*\)")
CTEST = re.compile(r"\bNAME\s+([A-Z]\w*)\.([\w$*{}]+)")
# `Suite.Test`, and `.Test` of the suite named before it; a `*` stands for the rest of a name.
NAMED = re.compile(r"`([A-Z]\w*\*?)?\.(\*|[A-Z][\w*]*)`")
LINK = re.compile(r"\]\(([^)\s]+)\)")
# What the words of the glossary replaced, as parts of names.
OLD_WORDS = re.compile(
    r"(?:picture_size|PictureSize|PictureLink|CameraNews|CameraKeeper|DoubtfulCamera|CameraDoubt|doubt_camera|FoundOut|FoundCamera"
    r"|PlaceDesk|PlaceAnswer|PlaceQuery|PlaceVerdict|PoseSuggestion|LabelBook|ProposalBook|OverlapBook|NewestQuestions|kQuestion"
    r"|SerialQueue|ServiceLanes|HeldLane|beside_store|run_beside|let_images_go|bytes_to_wake|bytes_let_go|proven_in"
    r"|PointElimination|few_views|linearise|minimise|summarise|normalise|factorise|FirstBend|CameraPicture[SB])\w*")
# The same in what somebody reads: messages, help, Markdown. A row of a table names what keeps an older word.
OLD_PHRASES = re.compile(r"\b(?:found out|finds? cameras out|refuted|witness\w*|alikeness|place desk|window sums|(?<![-_])pictures? (?!of))\b", re.IGNORECASE)
# A function of a header that can fail.
FALLIBLE = re.compile(r"^[ \t]*(?:\[\[nodiscard\]\]\s+)?(?:(?:static|virtual|inline|friend|constexpr)\s+)*(?:Status|Result<[^;{}()]*?>)\s+\w+\(", re.MULTILINE)
LITERAL = re.compile(r'"(?:[^"\\\n]|\\.)*"')


def files(*endings):
    for folder, folders, names in os.walk(ROOT):
        folders[:] = [name for name in folders if name != "build" and (not name.startswith(".") or name == ".ci")]
        yield from (pathlib.Path(folder, name) for name in names if name.endswith(endings))


def names_of_tests():
    names = set()
    for file in files(".h", ".cpp"):
        names.update(f"{suite}.{test}" for suite, test in GTEST.findall(file.read_text(errors="replace")))
    for file in files("CMakeLists.txt", ".cmake"):
        # What a loop puts in the place of ${case} is as good as any name.
        names.update(f"{suite}.{re.sub(r'[$]{.*}', '*', test)}" for suite, test in CTEST.findall(file.read_text()))
    return names


def is_there(wanted, names):
    return any(fnmatch.fnmatchcase(name, wanted) or fnmatch.fnmatchcase(wanted, name) for name in names)


def anchors(text):
    """Of its headings, as a forge makes them."""
    for heading in re.findall(r"^#+ +(.*)$", text, re.MULTILINE):
        plain = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).lower()
        yield re.sub(r"[^\w\- ]", "", plain).replace(" ", "-")


class Texts(unittest.TestCase):
    def test_every_test_that_is_named_is_there(self):
        names = names_of_tests()
        self.assertGreater(len(names), 1000, "of the tests hardly any was found")
        missing = []
        for text in files(".md"):
            before = None
            for number, line in enumerate(text.read_text().splitlines(), 1):
                for suite, test in NAMED.findall(line):
                    before = suite or before
                    if before is None or not is_there(f"{before}.{test}", names):
                        missing.append(f"{text.relative_to(ROOT)}:{number}: {before or ''}.{test}")
        self.assertEqual(missing, [], "no such tests")

    def test_every_link_leads_somewhere(self):
        broken = []
        for text in files(".md"):
            for link in LINK.findall(text.read_text()):
                if "://" in link:
                    continue
                path, _, anchor = link.partition("#")
                target = (text.parent / path).resolve() if path else text
                if not target.exists() or (anchor and anchor not in anchors(target.read_text())):
                    broken.append(f"{text.relative_to(ROOT)}: {link}")
        self.assertEqual(broken, [], "no such files or headings")

    def test_names_that_the_glossary_replaced_do_not_come_back(self):
        found = {f"{source.relative_to(ROOT)}: {name}"
                 for source in files(".h", ".cpp", ".inc") for name in OLD_WORDS.findall(source.read_text(errors="replace"))}
        self.assertEqual(sorted(found), [], "common/README.md has the words for these")

    def test_phrases_that_the_glossary_replaced_do_not_come_back(self):
        found = []
        for source in files(".cpp", ".h", ".md"):
            if source.name.endswith("_test.cpp"):
                continue
            text = source.read_text(errors="replace")
            read = [line for line in text.splitlines() if not line.startswith("|")] if source.suffix == ".md" else LITERAL.findall(text)
            found += [f"{source.relative_to(ROOT)}: {line.strip()}" for line in read if OLD_PHRASES.search(line)]
        self.assertEqual(found, [], "common/README.md has the words for these")

    def test_no_result_may_be_dropped_unseen(self):
        count = 0
        for header in files(".h"):
            text = header.read_text(errors="replace")
            for function in FALLIBLE.finditer(text):
                count += 1
                self.assertIn("[[nodiscard]]", function.group(), f"{header.relative_to(ROOT)}: {function.group().strip()}")
        self.assertGreater(count, 300, "of them hardly any was found")


if __name__ == "__main__":
    unittest.main(verbosity=2)
