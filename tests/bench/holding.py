# SPDX-License-Identifier: Apache-2.0
"""How well a camera was held: shares, losses, and poses that are claimed and wrong. Standard library only."""
import math
import random

from playing import is_tracked, percentile

WRONG_SHARE = 0.03  # of the depth
WRONG_DEGREES = 2.0
TRIES = 300


def multiply(a, b):
    """Of quaternions x y z w."""
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return (aw * bx + ax * bw + ay * bz - az * by, aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw, aw * bw - ax * bx - ay * by - az * bz)


def conjugate(q):
    return -q[0], -q[1], -q[2], q[3]


def rotate(q, v):
    return multiply(multiply(q, (*v, 0.0)), conjugate(q))[:3]


def degrees_between(a, b):
    w = abs(sum(x * y for x, y in zip(a, b)))
    return math.degrees(2 * math.acos(min(1.0, w)))


def mean_rotation(quaternions):
    """Of rotations that are near each other."""
    first = quaternions[0]
    total = [0.0] * 4
    for q in quaternions:
        sign = 1 if sum(x * y for x, y in zip(first, q)) >= 0 else -1
        total = [t + sign * x for t, x in zip(total, q)]
    norm = math.sqrt(sum(t * t for t in total))
    return tuple(t / norm for t in total)


def subtract(a, b):
    return tuple(x - y for x, y in zip(a, b))


class Pose:
    """A pose that was claimed, with the truth: both camera to world, quaternions x y z w; `depth` in the truth's unit; `frame`: its
    number. `turns_only`: only its rotation was claimed."""

    def __init__(self, frame, place, rotation, true_place, true_rotation, depth, turns_only=False):
        self.frame, self.place, self.rotation = frame, place, rotation
        self.true_place, self.true_rotation, self.depth = true_place, true_rotation, depth
        self.turns_only = turns_only


class Similarity:
    """truth_from_map."""

    def __init__(self, rotation, scale, shift):
        self.rotation, self.scale, self.shift = rotation, scale, shift

    def error(self, pose):
        """The vector by which a place is off."""
        turned = rotate(self.rotation, pose.place)
        return tuple(self.scale * x + t - true for x, t, true in zip(turned, self.shift, pose.true_place))

    def off(self, pose):
        return math.hypot(*self.error(pose))

    def degrees(self, pose):
        return degrees_between(multiply(self.rotation, pose.rotation), pose.true_rotation)


def common_rotation(poses):
    """The rotation that most poses agree on."""
    turns = [multiply(p.true_rotation, conjugate(p.rotation)) for p in poses]
    some = turns[::max(1, len(turns) // 60)]
    best = max(some, key=lambda q: sum(degrees_between(q, other) < WRONG_DEGREES for other in some))
    for _ in range(2):
        best = mean_rotation([q for q in turns if degrees_between(best, q) < WRONG_DEGREES] or [best])
    return best


def fit(rotation, poses):
    """Scale and shift by least squares; None: they do not move."""
    turned = [rotate(rotation, p.place) for p in poses]
    count = len(poses)
    middle = tuple(sum(v[i] for v in turned) / count for i in range(3))
    true_middle = tuple(sum(p.true_place[i] for p in poses) / count for i in range(3))
    spread = sum(sum(x * x for x in subtract(v, middle)) for v in turned)
    if spread < 1e-12:
        return None
    scale = sum(sum(x * y for x, y in zip(subtract(v, middle), subtract(p.true_place, true_middle)))
                for v, p in zip(turned, poses)) / spread
    return Similarity(rotation, scale, tuple(t - scale * m for t, m in zip(true_middle, middle))) if scale > 0 else None


def align(poses):
    """The similarity that most poses of a map agree on, whatever the others say. None: too few, or they do not move."""
    placed = [p for p in poses if not p.turns_only]
    if len(placed) < 3:
        return None
    rotation = common_rotation(placed)
    draw = random.Random(1)

    def agreeing(similarity):
        return [p for p in placed if similarity.off(p) <= WRONG_SHARE * p.depth]
    best, most = fit(rotation, placed), -1
    some = placed[::max(1, len(placed) // 100)]
    for _ in range(TRIES):
        candidate = fit(rotation, draw.sample(placed, 2))
        if candidate is None:
            continue
        count = sum(candidate.off(p) <= WRONG_SHARE * p.depth for p in some)
        if count > most:
            best, most = candidate, count
    for _ in range(5):
        inliers = agreeing(best) if best else []
        if len(inliers) < 3:
            break
        best = fit(rotation, inliers) or best
    return best


def frozen_of(poses):
    """Frames of poses that fit no similarity, where the camera went away from where it was first."""
    placed = [p for p in poses if not p.turns_only]
    return [p.frame for p in placed if math.hypot(*subtract(p.true_place, placed[0].true_place)) > WRONG_SHARE * p.depth]


def judge_poses(poses_by_map, jump_m=None):
    """Counts wrong poses. jump_m: of a long way, on which any map drifts, a pose is wrong once the error has jumped by as much from one
    pose to the next, until it jumps back. Poses that stand still while the camera moves are wrong; `unaligned` are those of maps with too
    few to be judged."""
    told = {"judged": 0, "wrong": 0, "wrong_frames": [], "unaligned": 0}
    degrees, offs = [], []
    for poses in poses_by_map.values():
        similarity = align(poses)
        if similarity is None:
            frozen = frozen_of(poses)
            told["wrong_frames"] += frozen
            told["unaligned"] += len(poses) - len(frozen)
            continue
        jumped, last = (0.0, 0.0, 0.0), None
        for pose in poses:
            turned = similarity.degrees(pose)
            degrees.append(turned)
            wrong = turned > WRONG_DEGREES
            if not pose.turns_only:
                error = similarity.error(pose)
                offs.append(math.hypot(*error) / pose.depth)
                if jump_m is None:
                    wrong = wrong or offs[-1] > WRONG_SHARE
                else:
                    step = subtract(error, last or error)
                    if math.hypot(*step) > jump_m:
                        jumped = tuple(j + s for j, s in zip(jumped, step))
                    wrong = math.hypot(*jumped) > jump_m
                    last = error
            if wrong:
                told["wrong_frames"].append(pose.frame)
    told["judged"] = sum(len(poses) for poses in poses_by_map.values()) - told["unaligned"]
    told["wrong"] = len(told["wrong_frames"])
    if degrees:
        told["rotation_p95"] = round(percentile(degrees, 0.95), 2)
        told["rotation_max"] = round(max(degrees), 2)
    if offs:
        told["off_percent_p95"] = round(100 * percentile(offs, 0.95), 2)
    return told


def is_held(frame):
    """A pose, or an honest rotation."""
    return is_tracked(frame) or frame["state"] == "rotation"


def losses_of(frames):
    """Of each loss after a map: frames from the first without a pose to the first with one in the map that was left; None: another map
    came first, or none at all."""
    waits, begin, last = [], None, None
    for number, frame in enumerate(frames):
        if frame["state"] in ("dropped", "starting"):
            continue
        if is_held(frame):
            if begin is not None:
                waits.append(number - begin if frame["map"] == last else None)
            begin, last = None, frame["map"]
        elif begin is None and last is not None:
            begin = number
    return waits + ([None] if begin is not None else [])


def share_percent(frames, holds=is_held):
    return round(100 * sum(map(holds, frames)) / len(frames), 2) if frames else None
