// SPDX-License-Identifier: Apache-2.0
//
// One number for what the whole tracker makes of a few images, written down: the poses of a camera on a map,
// a blackout and the recovery from keyframes are equal to the byte on x86-64 with and without AVX2 and on
// ARM64. common/image/lockstep_test.cpp says the same of the kernels alone.
#include <gtest/gtest.h>

#include <numbers>

#include "client/tracking/seeded_tracker.h"
#include "common/image/test_textures.h"

namespace cairn {
namespace {

constexpr int64_t kFrame = 33'333'333;  // [ns]

/// Above the plane at (x, y, 1 m), looking down.
SE3 above(double x, double y) {
  const Eigen::Quaterniond camera_from_map(0, 1, 0, 0);
  return {camera_from_map, -(camera_from_map * Eigen::Vector3d(x, y, 1))};
}

void add(const SE3& pose, test::Hash* hash) {
  for (const double value : pose.translation()) hash->add(value);
  for (const double value : pose.rotation().coeffs()) hash->add(value);
}

TEST(LockstepTest, TrackingAgreesOnEveryProcessor) {
  const CameraPtr camera = *make_camera(
      {CameraModel::kPinholeRadtan, 320, 240, {262, 262, 159.5, 119.5, -0.1, 0.02, 0.001, -0.001}});
  test::TrackerOnPlane plane(camera, above(0, 0));
  test::Hash images;
  test::Hash poses;
  int measured = 0;
  for (int frame = 0; frame < 24; ++frame) {
    const bool dark = frame >= 12 && frame < 16;
    const GrayImagePtr image = dark ? std::make_shared<GrayImage>(camera->width(), camera->height())
                                    : plane.scene.render(above(0.008 * frame, -0.004 * frame));
    for (int y = 0; y < image->height(); ++y)
      for (int x = 0; x < image->width(); ++x) images.add(image->row(y)[x]);
    const FrameResult& result = plane.tracker.track(image, {frame * kFrame}, plane.map);
    if (result.reloc_query) static_cast<void>(plane.tracker.relocalization_answered(std::nullopt));
    measured += result.pose_measured ? 1 : 0;
    poses.add(result.found);
    add(result.camera_from_map, &poses);
  }
  EXPECT_GE(measured, 16);
  EXPECT_EQ(images.value, 0x25DAA0DE2EC6477AULL) << "what is tracked differs: nothing is said of the tracker";
  EXPECT_EQ(poses.value, 0x54D74ABEF52CA3F8ULL);
}

}  // namespace
}  // namespace cairn
