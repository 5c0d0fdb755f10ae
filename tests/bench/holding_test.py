#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Laws of holding.py on made trajectories. Standard library only."""
import math
import random
import unittest

import holding


def about_z(degrees):
    return 0.0, 0.0, math.sin(math.radians(degrees) / 2), math.cos(math.radians(degrees) / 2)


def walk(count=200, moved=lambda i: (0.0, 0.0, 0.0), turned=lambda i: 0.0):
    """Poses of a map that is turned, scaled and shifted against the truth; single ones moved [truth's unit] or turned [degrees]."""
    draw = random.Random(3)
    world = holding.multiply(about_z(70), (math.sin(0.4), 0.0, 0.0, math.cos(0.4)))
    poses = []
    for i in range(count):
        place = (math.sin(i / 20), i / 50, 0.3 * math.cos(i / 11))
        rotation = about_z(i)
        noisy = [x + draw.gauss(0, 0.002) + m for x, m in zip(place, moved(i))]
        shifted = [x - s for x, s in zip(noisy, (4, 5, 6))]
        in_map = [x / 2.5 for x in holding.rotate(holding.conjugate(world), shifted)]
        seen = holding.multiply(about_z(turned(i)), rotation)
        poses.append(holding.Pose(i, in_map, holding.multiply(holding.conjugate(world), seen), place, rotation, 1.0))
    return poses


class Alignment(unittest.TestCase):
    def test_a_right_map_has_no_wrong_poses_whatever_its_frame_and_scale(self):
        told = holding.judge_poses({"m": walk()})
        self.assertEqual((told["judged"], told["wrong"]), (200, 0))
        self.assertAlmostEqual(holding.align(walk()).scale, 2.5, places=2)

    def test_a_third_of_wrong_poses_does_not_move_the_rest(self):
        told = holding.judge_poses({"m": walk(moved=lambda i: (0.1 if i % 3 == 0 else 0.0, 0.0, 0.0))})
        self.assertEqual(told["wrong_frames"], list(range(0, 200, 3)))

    def test_a_pose_that_is_turned_is_wrong_where_it_stands_right(self):
        told = holding.judge_poses({"m": walk(turned=lambda i: 5 if 50 <= i < 60 else 0)})
        self.assertEqual(told["wrong_frames"], list(range(50, 60)))
        self.assertAlmostEqual(told["rotation_max"], 5, places=1)

    def test_maps_are_judged_each_by_itself(self):
        told = holding.judge_poses({"a": walk(), "b": walk(moved=lambda i: (9.0, 0.0, 0.0))})
        self.assertEqual(told["wrong"], 0)

    def test_a_pose_that_stands_still_while_the_camera_moves_is_wrong(self):
        poses = walk(count=60)
        for pose in poses:
            pose.place = (1.0, 2.0, 3.0)
        told = holding.judge_poses({"m": poses, "young": walk(count=2)})
        self.assertEqual((told["judged"] + told["unaligned"], told["unaligned"]), (62, 2 + 60 - told["wrong"]))
        self.assertGreater(told["wrong"], 50)

    def test_on_a_long_way_drift_is_right_and_a_bay_is_not_until_it_is_taken_back(self):
        def moved(i):
            return (0.0, 0.004 * i + (1.5 if 100 <= i < 130 else 0.0), 0.0)
        told = holding.judge_poses({"m": walk(moved=moved)}, jump_m=1.0)
        self.assertEqual(told["wrong_frames"], list(range(100, 130)))

    def test_of_a_rotation_only_that_is_judged(self):
        poses = walk()
        for pose in poses[150:]:
            pose.place, pose.turns_only = (0.0, 0.0, 0.0), True
        self.assertEqual(holding.judge_poses({"m": poses})["wrong"], 0)


class Losses(unittest.TestCase):
    @staticmethod
    def frames(text):
        """t: tracked in map 1; u: in map 2; r: rotation; l: lost; s: starting; d: dropped."""
        states = {"t": ("tracking", 1), "u": ("tracking", 2), "r": ("rotation", 1), "l": ("lost", 1), "s": ("starting", None),
                  "d": ("dropped", None)}
        return [dict(zip(("state", "map"), states[letter])) for letter in text]

    def test_wait_until_the_same_map(self):
        for text, waits in (("sstttt", []), ("sttlltt", [2]), ("ttldltlt", [3, 1]), ("ttrrtt", []), ("ttll", [None]),
                            ("ttlluult", [None, None]), ("tddt", [])):
            self.assertEqual(holding.losses_of(self.frames(text)), waits, text)

    def test_share_counts_rotation_and_dropped_frames(self):
        self.assertEqual(holding.share_percent(self.frames("ttrd")), 75)
        self.assertIsNone(holding.share_percent([]))


if __name__ == "__main__":
    unittest.main()
