# SPDX-License-Identifier: Apache-2.0
"""COLMAP's sparse models, read and projected as its documentation says: pixel (0.5, 0.5) is the centre of the first, quaternions
have w first and turn from world to camera. Nothing of it is shared with what writes them. Standard library only."""
import math
import struct

NUMBERS = {1: "PINHOLE", 4: "OPENCV", 5: "OPENCV_FISHEYE", 6: "FULL_OPENCV", 7: "FOV"}
PARAMETERS = {"PINHOLE": 4, "OPENCV": 8, "OPENCV_FISHEYE": 8, "FULL_OPENCV": 12, "FOV": 5}


def rows_of(path):
    return [line.rstrip("\n") for line in path.read_text().splitlines() if not line.startswith("#")]


def read_text(folder):
    """Cameras, images and points, each by its number, of tuples as read_binary() has them."""
    cameras, images, points = {}, {}, {}
    for row in rows_of(folder / "cameras.txt"):
        number, model, width, height, *values = row.split()
        cameras[int(number)] = (model, int(width), int(height), tuple(map(float, values)))
    rows = rows_of(folder / "images.txt")
    for row, found in zip(rows[::2], rows[1::2]):
        number, *pose, camera, name = row.split()
        words = found.split()
        found = tuple((float(x), float(y), int(p)) for x, y, p in zip(words[::3], words[1::3], words[2::3]))
        images[int(number)] = (tuple(map(float, pose)), int(camera), name, found)
    for row in rows_of(folder / "points3D.txt"):
        number, x, y, z, red, green, blue, error, *track = row.split()
        track = tuple(zip(map(int, track[::2]), map(int, track[1::2])))
        points[int(number)] = ((float(x), float(y), float(z)), (int(red), int(green), int(blue)), float(error), track)
    return cameras, images, points


class Bytes:
    def __init__(self, path):
        self.data, self.at = path.read_bytes(), 0

    def take(self, form):
        values = struct.unpack_from("<" + form, self.data, self.at)
        self.at += struct.calcsize("<" + form)
        return values if len(values) > 1 else values[0]

    def text(self):
        end = self.data.index(0, self.at)
        text = self.data[self.at:end].decode()
        self.at = end + 1
        return text

    def items(self):
        for _ in range(self.take("Q")):
            yield
        assert self.at == len(self.data), "bytes behind the end"


def read_binary(folder):
    cameras, images, points = {}, {}, {}
    file = Bytes(folder / "cameras.bin")
    for _ in file.items():
        number, model, width, height = file.take("IiQQ")
        cameras[number] = (NUMBERS[model], width, height, file.take(f"{PARAMETERS[NUMBERS[model]]}d"))
    file = Bytes(folder / "images.bin")
    for _ in file.items():
        number, *pose, camera = file.take("I7dI")
        name = file.text()
        images[number] = (tuple(pose), camera, name, tuple(file.take("ddQ") for _ in range(file.take("Q"))))
    file = Bytes(folder / "points3D.bin")
    for _ in file.items():
        number, x, y, z, red, green, blue, error, length = file.take("QdddBBBdQ")
        points[number] = ((x, y, z), (red, green, blue), error, tuple(file.take("II") for _ in range(length)))
    return cameras, images, points


def rotate(quaternion, vector):
    w, *u = quaternion

    def cross(a, b):
        return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
    twice = [2 * c for c in cross(u, vector)]
    return [v + w * t + c for v, t, c in zip(vector, twice, cross(u, twice))]


def distort(model, more, u, v):
    """By the parameters behind fx fy cx cy."""
    r = math.hypot(u, v)
    if model == "FOV":
        omega, = more
        scale = math.atan(2 * r * math.tan(omega / 2)) / omega / r if r > 1e-9 else 2 * math.tan(omega / 2) / omega
        return u * scale, v * scale
    if model == "OPENCV_FISHEYE":
        theta = math.atan(r)
        bent = theta * (1 + sum(k * theta ** (2 * i) for i, k in enumerate(more, 1)))
        return (u * bent / r, v * bent / r) if r > 1e-9 else (u, v)
    k1, k2, p1, p2, k3, k4, k5, k6 = (*more, *[0] * 8)[:8]
    square = r * r
    radial = (1 + k1 * square + k2 * square ** 2 + k3 * square ** 3) / (1 + k4 * square + k5 * square ** 2 + k6 * square ** 3)
    return (u * radial + 2 * p1 * u * v + p2 * (square + 2 * u * u), v * radial + 2 * p2 * u * v + p1 * (square + 2 * v * v))


def project(camera, pose, point):
    """Where in the image a point is seen, in COLMAP's pixels."""
    model, _, _, (fx, fy, cx, cy, *more) = camera
    x, y, z = (a + b for a, b in zip(rotate(pose[:4], point), pose[4:]))
    assert z > 0, "behind the camera"
    u, v = distort(model, more, x / z, y / z)
    return fx * u + cx, fy * v + cy


def distances(cameras, images, points):
    """Of each point's measurements from its projections, in pixels, by its number."""
    found = {}
    for pose, camera, _, pixels in images.values():
        for x, y, number in pixels:
            at = project(cameras[camera], pose, points[number][0])
            found.setdefault(number, []).append(math.dist(at, (x, y)))
    return found
