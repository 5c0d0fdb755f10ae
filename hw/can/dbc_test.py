#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The codecs of hw/can against rig.dbc, as an independent reader of such files (Debian's python3-canmatrix) takes it.

dbc_test.py DBC_EXCHANGE [SEED]   With random messages, in both directions. Exit code 77: no canmatrix here (1 where CI=true).
"""
import logging
import os
import pathlib
import random
import struct
import subprocess
import sys
import unittest
import warnings

NOT_HERE = 77
COUNT = 50  # of each kind of message
LIMIT = 60  # [s]

try:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        logging.disable(logging.WARNING)  # it says which other formats it cannot read here
        import canmatrix.formats
except ImportError:
    print("dbc_test: no canmatrix; `deploy/install-packages test` installs it (python3-canmatrix)", file=sys.stderr)
    sys.exit(1 if os.environ.get("CI") == "true" else NOT_HERE)


class Line:
    """A frame as dbc_exchange writes it."""

    def __init__(self, text):
        number, payload, self.name, *signals = text.split()
        self.id = int(number)
        self.payload = b"" if payload == "-" else bytes.fromhex(payload)
        self.signals = {name: float(value) for name, value in (signal.split("=") for signal in signals)}


def exchange(*arguments, text=""):
    done = subprocess.run([EXCHANGE, *arguments], input=text, capture_output=True, text=True, timeout=LIMIT)
    if done.returncode != 0:
        raise AssertionError(f"{arguments}: exit code {done.returncode}: {done.stderr}")
    return [Line(line) for line in done.stdout.splitlines()]


def random_raw(signal, source):
    if signal.is_float:
        return struct.unpack("<f", struct.pack("<f", source.uniform(-1e4, 1e4)))[0]
    if signal.is_signed:
        return source.randint(-(2 ** (signal.size - 1)), 2 ** (signal.size - 1) - 1)
    return source.randint(0, 2 ** signal.size - 1)


class Dbc(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.matrix = canmatrix.formats.loadp_flat(str(pathlib.Path(__file__).with_name("rig.dbc")))
        cls.frames = {frame.arbitration_id.id: frame for frame in cls.matrix.frames}

    def assert_same(self, frame, expected, values, steps):
        """Equal but for float32, and for `steps` of the raw number."""
        self.assertEqual(set(expected), set(values), frame.name)
        for signal in frame.signals:
            value = float(values[signal.name])
            allowed = 1e-6 * max(1.0, abs(value)) + (0 if signal.is_float else steps * float(signal.factor))
            self.assertAlmostEqual(float(expected[signal.name]), value, delta=allowed, msg=f"{frame.name}.{signal.name}")

    def test_what_the_codec_encodes_the_reader_decodes(self):
        lines = exchange("encode", str(SEED), str(COUNT))
        self.assertEqual({line.name for line in lines}, {frame.name for frame in self.matrix.frames})
        for line in lines:
            frame = self.frames[line.id]
            self.assertEqual((frame.name, frame.size), (line.name, len(line.payload)))
            values = frame.decode(line.payload) if frame.signals else {}
            self.assert_same(frame, line.signals, {name: value.phys_value for name, value in values.items()}, steps=0.5)

    def test_what_the_reader_encodes_the_codec_decodes(self):
        source = random.Random(SEED)
        sent = []
        for frame in self.matrix.frames:
            for _ in range(COUNT):
                raw = {signal.name: random_raw(signal, source) for signal in frame.signals}
                payload = frame.encode(raw) if frame.signals else b""
                values = {signal.name: raw[signal.name] * float(signal.factor) for signal in frame.signals}
                sent.append((frame, values, bytes(payload)))
        text = "".join(f"{frame.arbitration_id.id} {payload.hex() or '-'}\n" for frame, _, payload in sent)
        lines = exchange("decode", text=text)
        self.assertEqual(len(lines), len(sent))
        for line, (frame, values, payload) in zip(lines, sent):
            self.assertEqual((line.name, line.payload), (frame.name, payload))
            self.assert_same(frame, values, line.signals, steps=0)

    def test_floats_are_declared_as_such(self):
        floats = {f"{frame.name}.{s.name}" for frame in self.matrix.frames for s in frame.signals if s.is_float}
        self.assertEqual(len(floats), 2 * 5, floats)


if __name__ == "__main__":
    if len(sys.argv) < 2 or sys.argv[1] in ("-h", "--help"):
        print(__doc__.strip())
        sys.exit(0 if len(sys.argv) > 1 else 2)
    EXCHANGE = sys.argv.pop(1)
    SEED = int(sys.argv.pop(1)) if len(sys.argv) > 1 and sys.argv[1].isdigit() else random.randrange(2 ** 32)
    print(f"seed {SEED}", file=sys.stderr)
    unittest.main(verbosity=2)
