#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""What batches.py puts together: files that, included by one, still compile."""
import pathlib
import subprocess
import tempfile
import unittest

BATCHES = pathlib.Path(__file__).resolve().parent / "batches.py"


class Batches(unittest.TestCase):
    def batches(self, *texts, size=20):
        """The files' numbers, batch by batch."""
        with tempfile.TemporaryDirectory() as folder:
            files = [pathlib.Path(folder) / f"{i}.cpp" for i in range(len(texts))]
            for file, text in zip(files, texts):
                file.write_text(text)
            done = subprocess.run([BATCHES, str(size), *files], capture_output=True, text=True, check=True)
        batches = {}
        for line in done.stdout.splitlines():
            number, name = line.split()
            batches.setdefault(number, []).append(int(pathlib.Path(name).stem))
        return list(batches.values())

    def assert_apart(self, one, other):
        self.assertEqual(self.batches(one, other), [[0], [1]])

    def assert_together(self, one, other):
        self.assertEqual(self.batches(one, other), [[0, 1]])

    def test_names_of_their_own_go_together(self):
        self.assert_together("int a() {\n}\n", "int b() {\n}\n")

    def test_one_name_twice_does_not(self):
        for text in ("int a() {\n}\n", "struct A {\n};\n", "constexpr int kA = 1;\n", "using A = int;\n", "enum Kind { kA, kB };\n",
                     "template <typename T>\nT a(T x) {\n}\n", "std::string a(int x, Camera c) {\n}\n"):
            self.assert_apart(text, text)

    def test_functions_go_together_where_their_first_arguments_are_of_other_classes(self):
        self.assert_together("void write(const Map& map) {\n}\n", "void write(const Frame& frame) {\n}\n")
        self.assert_apart("void write(const Map& map) {\n}\n", "void write(Map* map) {\n}\n")
        self.assert_apart("void write(const io::Map& map) {\n}\n", "void write(const wire::Map& map) {\n}\n")

    def test_a_function_and_what_is_no_function_do_not(self):
        self.assert_apart("void write(const Map& map) {\n}\n", "constexpr int write = 1;\n")
        self.assert_apart("void write(const Map& map) {\n}\n", "void write(int number) {\n}\n")

    def test_a_name_that_is_used_from_another_namespace_does_not_go_with_its_definition(self):
        self.assert_apart("using other::Thing;\n", "struct Thing {\n};\n")
        self.assert_together("using other::Thing;\n", "using other::Thing;\n")

    def test_members_and_locals_are_no_definitions(self):
        self.assert_together("void A::run() {\n  int x = 1;\n}\n", "void B::run() {\n  int x = 2;\n}\n")

    def test_a_batch_has_so_many_files_at_most(self):
        self.assertEqual(self.batches(*(f"int a{i}() {{\n}}\n" for i in range(5)), size=2), [[0, 1], [2, 3], [4]])

    def test_without_files_it_says_how_it_is_called(self):
        self.assertEqual(subprocess.run([BATCHES], capture_output=True, text=True).returncode, 2)


if __name__ == "__main__":
    unittest.main()
