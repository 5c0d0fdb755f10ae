// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>
#include <random>
#include <utility>
#include <vector>

#include "client/app/calibrate/board.h"
#include "client/capture/frame_source.h"
#include "common/geometry/camera.h"
#include "common/geometry/se3.h"

namespace cairn::testing {

inline const auto kNever = [] { return false; };

/// Images of a vector, one a second.
class Images final : public FrameSource {
 public:
  explicit Images(std::vector<GrayImagePtr> images) : images_(std::move(images)) {}
  [[nodiscard]] Result<std::optional<Frame>> next() override {
    if (next_ == images_.size()) return std::nullopt;
    const Frame frame{next_, {static_cast<int64_t>(next_) * 1'000'000'000}, images_[next_]};
    ++next_;
    return frame;
  }
  std::optional<size_t> frame_count() const override { return images_.size(); }
  std::string describe() const override { return "images"; }

 private:
  std::vector<GrayImagePtr> images_;
  size_t next_ = 0;
};

inline CameraPtr make_or_fail(const CameraParameters& parameters) {
  auto camera = make_camera(parameters);
  EXPECT_TRUE(camera.has_value()) << (camera ? "" : camera.error().message);
  return *camera;
}

/// A board of `width` x `height` whose middle is seen at a random place of the image, tilted up to
/// `max_tilt` [rad].
inline SE3 random_pose(const Camera& camera, double width, double height, double max_tilt,
                       std::mt19937* random) {
  const auto uniform = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(*random);
  };
  const double around = uniform(0, 2 * std::numbers::pi);
  const Eigen::Vector3d axis(std::cos(around), std::sin(around), 0);
  const Eigen::Quaterniond rotation =
      so3_exp(axis * uniform(0, max_tilt)) * so3_exp(Eigen::Vector3d::UnitZ() * uniform(-0.5, 0.5));
  const Eigen::Vector2d pixel(uniform(0.25, 0.75) * camera.width(), uniform(0.25, 0.75) * camera.height());
  const double distance = uniform(0.7, 1.3) * width * camera.focal_length() / (0.6 * camera.width());
  const Eigen::Vector3d centre = camera.unproject(pixel) * distance;
  return {rotation, centre - rotation * Eigen::Vector3d(0.5 * width, 0.5 * height, 0)};
}

/// Renders a plane image seen by a camera; `board_px` pixels of it make one unit, its pixel `origin` lies
/// at (0, 0).
class BoardPainter {
 public:
  BoardPainter(CameraPtr camera, GrayImage board, double board_px, double origin)
      : camera_(std::move(camera)), board_(std::move(board)), board_px_(board_px), origin_(origin) {
    for (int y = 0; y < camera_->height(); ++y) {
      for (int x = 0; x < camera_->width(); ++x) {
        for (int s = 0; s < kSamples * kSamples; ++s) {
          rays_.push_back(
              camera_->unproject({x + offset(s % kSamples), y + offset(s / kSamples)}).cast<float>());
        }
      }
    }
  }

  [[nodiscard]] GrayImagePtr paint(const SE3& camera_from_board, double noise, std::mt19937* random) const {
    const SE3 board_from_camera = camera_from_board.inverse();
    const Eigen::Matrix3f rotation = board_from_camera.rotation_matrix().cast<float>();
    const Eigen::Vector3f eye = board_from_camera.translation().cast<float>();
    auto image = std::make_shared<GrayImage>(camera_->width(), camera_->height());
    std::normal_distribution<float> grain(0, static_cast<float>(noise));
    const Eigen::Vector3f* ray = rays_.data();
    for (int y = 0; y < image->height(); ++y) {
      for (int x = 0; x < image->width(); ++x) {
        float sum = 0;
        for (int s = 0; s < kSamples * kSamples; ++s) sum += brightness(eye, rotation * *ray++);
        const float value = sum / (kSamples * kSamples) + grain(*random);
        image->row(y)[x] = static_cast<uint8_t>(std::lround(std::clamp(value, 0.0F, 255.0F)));
      }
    }
    return image;
  }

 private:
  static constexpr int kSamples = 3;
  static double offset(int sample) { return (sample + 0.5) / kSamples - 0.5; }

  [[nodiscard]] float brightness(const Eigen::Vector3f& eye, const Eigen::Vector3f& ray) const {
    constexpr float kTable = 110;
    const float along = -eye.z() / ray.z();
    if (!(along > 0)) return kTable;
    const auto at = [&](float on_board) {
      return static_cast<int>(
          std::floor(on_board * static_cast<float>(board_px_) + static_cast<float>(origin_)));
    };
    const int u = at(eye.x() + along * ray.x());
    const int v = at(eye.y() + along * ray.y());
    if (u < 0 || v < 0 || u >= board_.width() || v >= board_.height()) return kTable;
    return 30 + 0.75F * static_cast<float>(board_.row(v)[u]);
  }

  CameraPtr camera_;
  GrayImage board_;
  double board_px_;
  double origin_;
  std::vector<Eigen::Vector3f> rays_;
};

}  // namespace cairn::testing
