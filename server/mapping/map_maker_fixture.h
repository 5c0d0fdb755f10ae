// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <memory>
#include <vector>

#include "common/geometry/camera_guess.h"
#include "server/mapping/map_maker.h"
#include "server/mapping/test_scene.h"

/// Seeds and offers as a tracker would send them of the test scene, and a fixture with a map that is made of
/// them.
namespace cairn::testing {

inline const auto kNeverYield = [] { return false; };

/// Trails as a tracker would have them: corners of the first image, their true places in the second with a
/// pixel's rounding, one in ten wrong.
[[nodiscard]] std::vector<Trail> make_trails(const Scene& scene, const GrayImage& first,
                                             const SE3& first_pose, const SE3& second_pose);
/// The motion that a tracker finds from its trails: of the motions that explain them, the one nearest to the
/// truth.
[[nodiscard]] SE3 motion_between(const SeedInput& input, const SE3& true_motion);
/// A frame of the scene as a tracker offers it: points of the snapshot measured to a pixel around where they
/// should be.
[[nodiscard]] KeyframeInput make_offer(const Scene& scene, const MapSnapshot& s, int step);
/// make_offer() with an image that has been rendered already.
[[nodiscard]] KeyframeInput make_offer(const Scene& scene, const MapSnapshot& s, int step,
                                       GrayImagePtr image);

/// The scene that a fixture's map is of, and that map's seed. Under sanitizers, where many cases share a
/// process, to render it takes most of the time, so they share it.
[[nodiscard]] const Scene& two_planes();
[[nodiscard]] const SeedInput& seed_of_two_planes();

/// The bytes of everything in a snapshot that is made of numbers.
[[nodiscard]] std::vector<uint8_t> bytes_of(const MapSnapshot& s);

/// A map of Scene as it is made: seed, offers, work.
class MapMakerFixture : public ::testing::Test {
 protected:
  void start() {
    auto started = MapMaker::start(input_, options_);
    ASSERT_TRUE(started) << started.error().message;
    maker_ = std::move(started->first);
    seed_ = std::move(started->second);
  }

  void work() {
    for (int i = 0; i < 100; ++i) {
      if (maker_->step(kNeverYield).work == MapWork::kNone) return;
    }
    FAIL() << "the work does not end";
  }

  /// From now on the camera is believed to have another focal length, and is to be calibrated.
  void use_prior(double focal_factor) {
    CameraParameters parameters = scene_.camera()->parameters();
    parameters.values.resize(kPriorValues, 0.0);
    for (const size_t i : {0, 1}) parameters.values[i] *= focal_factor;
    input_.camera = *make_camera(parameters);
    input_.second_from_first = motion_between(input_, input_.second_from_first);
    input_.prior = CameraPrior{{ClientId{{1}}, 0, 1}, {0.1, 0.05}};
  }

  /// From now on all left of this pixel stands still in every image.
  void mask_left_of(int pixel) {
    const int width = scene_.camera()->width() / 8;
    std::vector<uint8_t> still(static_cast<size_t>(width * (scene_.camera()->height() / 8)), 0);
    for (size_t i = 0; i < still.size(); ++i) still[i] = static_cast<int>(i) % width < pixel / 8;
    input_.still = std::make_shared<const StillMask>(width, scene_.camera()->height() / 8, std::move(still));
  }

  /// Offers the view of a step and, when accepted, does all the work.
  KeyframeDecision offer(int step) {
    KeyframeInput offered = make_offer(scene_, *maker_->snapshot(), step);
    offered.prior = input_.prior;
    offered.still = input_.still;
    KeyframeDecision decision = maker_->add_keyframe(offered);
    if (decision.verdict == KeyframeVerdict::kAccepted) {
      steps_.push_back(step);
      work();
    }
    return decision;
  }

  StepReport adjust_globally() {
    const GlobalAdjustmentPtr problem = maker_->prepare_global_adjustment();
    solve(problem.get(), {});
    return maker_->adopt(*problem);
  }

  const Scene& scene_ = two_planes();
  SeedInput input_ = seed_of_two_planes();
  MapMakerOptions options_;
  std::unique_ptr<MapMaker> maker_;
  SeedResult seed_;
  std::vector<int> steps_{0, kSecondStep};  ///< Scene::pose() of each keyframe
};

}  // namespace cairn::testing
