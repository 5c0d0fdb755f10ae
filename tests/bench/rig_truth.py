# SPDX-License-Identifier: Apache-2.0
"""Where the camera of a simulated rig truly is. Standard library only."""
import math
import socket
import statistics
import struct
import threading

from holding import Pose, rotate

PACKET = struct.Struct("q3d4d")  # as Packet of tests/world/camera_feed.cpp


def add(a, b):
    return [x + y for x, y in zip(a, b)]


def scaled(a, factor):
    return [factor * x for x in a]


def dot(a, b):
    return sum(x * y for x, y in zip(a, b))


def unit(a):
    return scaled(a, 1 / math.sqrt(dot(a, a)))


def degrees_between(a, b):
    return math.degrees(math.acos(max(-1.0, min(1.0, dot(unit(a), unit(b))))))


def rms(values):
    return math.sqrt(statistics.fmean(v * v for v in values))


def nearest_point(rays):
    """The point that (origin, direction) pass by most closely, by least squares."""
    a = [[0.0] * 3 for _ in range(3)]
    b = [0.0] * 3
    for origin, direction in rays:
        d = unit(direction)
        for i in range(3):
            for j in range(3):
                m = (i == j) - d[i] * d[j]
                a[i][j] += m
                b[i] += m * origin[j]

    def determinant(m):
        return (m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) - m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0])
                + m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0]))
    whole = determinant(a)
    return [determinant([[b[r] if c == k else a[r][c] for c in range(3)] for r in range(3)]) / whole for k in range(3)]


class Truth:
    """Where the camera is, as the simulated rig tells it."""

    def __init__(self, path):
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.socket.connect(str(path))
        self.moments = []  # (time [s], centre, quaternion)
        self.thread = threading.Thread(target=self.read, daemon=True)
        self.thread.start()

    def read(self):
        while len(packet := self.socket.recv(PACKET.size)) == PACKET.size:
            when, *pose = PACKET.unpack(packet)
            self.moments.append((when * 1e-9, pose[:3], pose[3:]))

    def now(self):
        return self.moments[-1][0]

    def between(self, begin, end):
        return [m for m in self.moments if begin <= m[0] < end]

    def pose(self, row):
        """A row of a trajectory as holding judges it; the point that the wearer walks around, the origin, is at the depth."""
        _, centre, turn = self.at(row[0])
        return Pose(row[0], row[1], row[2], centre, turn, math.sqrt(dot(centre, centre)))

    def at(self, when):
        low, high = 0, len(self.moments) - 1
        while low < high:
            middle = (low + high) // 2
            low, high = (middle + 1, high) if self.moments[middle][0] < when else (low, middle)
        return self.moments[low]


def axis_of(moment):
    return rotate(moment[2], [0, 0, 1])


def read_trajectory(path):
    """(time [s], centre, quaternion x y z w) a row."""
    rows = [[float(number) for number in row.split()] for row in path.read_text().splitlines() if row[:1] not in ("#", "")]
    return [(row[0], row[1:4], row[4:8]) for row in rows]
