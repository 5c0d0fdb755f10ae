#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The judge of run-rig. Standard library only."""
import pathlib
import random
import socket
import tempfile
import unittest

from rig_truth import PACKET, Truth, add, axis_of, degrees_between, nearest_point, read_trajectory, scaled


class RigTruth(unittest.TestCase):
    def test_rays_meet(self):
        chance = random.Random(1)
        point = [0.2, -3, 1]
        origins = [[chance.uniform(-1, 1) for _ in range(3)] for _ in range(5)]
        self.assertLess(degrees_between(nearest_point([(origin, add(point, scaled(origin, -1))) for origin in origins]), point), 1e-4)

    def test_a_pose_is_laid_beside_the_moment_that_its_time_tells(self):
        with tempfile.TemporaryDirectory() as folder, socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as listener:
            listener.bind(f"{folder}/camera")
            listener.listen()
            truth = Truth(f"{folder}/camera")
            feed = listener.accept()[0]
            for i in range(100):
                feed.send(PACKET.pack(i * 10_000_000, 0.01 * i, 0, 2, 0, 0, 0, 1))
            feed.close()
            truth.thread.join(60)
            truth.socket.close()
            rows = pathlib.Path(folder, "rows.txt")
            rows.write_text("# a heading\n0.5 1 2 3 0 0 0 1\n")
            pose = truth.pose(*read_trajectory(rows))
        self.assertEqual((pose.place, list(pose.true_place)), ([1, 2, 3], [0.5, 0, 2]))
        self.assertAlmostEqual(pose.depth, 4.25 ** 0.5)
        self.assertEqual([round(x, 9) for x in axis_of(truth.moments[0])], [0, 0, 1])
        self.assertEqual(len(truth.between(0.1, 0.2)), 10)


if __name__ == "__main__":
    unittest.main()
