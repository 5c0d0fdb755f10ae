// SPDX-License-Identifier: Apache-2.0
#include "client/tracking/motion.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "common/geometry/least_squares.h"
#include "common/image/pyramid.h"

namespace cairn {
Vector6d MotionModel::step_to(Timestamp time) const {
  return velocity_ * std::clamp(seconds_between(time, time_), 0.0, options_.longest_step);
}

SE3 MotionModel::predicted_step(Timestamp time) const {
  return SE3::exp(step_to(time));
}

SE3 MotionModel::predicted_step(Timestamp time, const SE3& turn) const {
  Vector6d step = step_to(time);
  step.tail<3>() = so3_log(turn.rotation());
  return SE3::exp(step);
}

bool MotionModel::is_leap(const SE3& camera_from_map, const SE3& predicted, Timestamp time,
                          double near_depth) const {
  const double seconds = std::max(options_.shortest_step, seconds_between(time, time_));
  const double apart = (camera_from_map.center() - predicted.center()).norm();
  return apart > options_.most_acceleration * seconds * seconds * near_depth;
}

void MotionModel::measured(const SE3& camera_from_map, Timestamp time) {
  const double seconds = seconds_between(time, time_);
  if (seconds > 0 && seconds < options_.longest_step) {
    const Vector6d newest = (camera_from_map * last_.inverse()).log() / seconds;
    velocity_ = options_.decay * (0.5 * newest + 0.5 * velocity_);
  } else if (seconds >= options_.longest_step) {
    velocity_.setZero();
  }
  last_ = camera_from_map;
  time_ = time;
}

void MotionModel::missed(const SE3& turn) {
  last_ = turn * last_;
  velocity_ *= options_.decay;
}

void MotionModel::reset(const SE3& camera_from_map, Timestamp time) {
  last_ = camera_from_map;
  time_ = time;
  velocity_.setZero();
}

SE3 correct_step(const SE3& predicted_step, const TinyMotion& seen, const Camera& camera, double mean_depth,
                 const StepCorrectionOptions& options) {
  if (!std::isfinite(seen.score)) return predicted_step;  // the tiny images have nothing in common
  constexpr int kTinyLevel = kPyramidLevels;              // the tiny image is level 3 halved again
  const Eigen::Vector2f center((static_cast<float>(camera.width() >> kTinyLevel) - 1.0F) / 2.0F,
                               (static_cast<float>(camera.height() >> kTinyLevel) - 1.0F) / 2.0F);
  const Eigen::Matrix2f turn = Eigen::Rotation2Df(seen.angle).toRotationMatrix();

  std::array<Eigen::Vector3d, 2> moved;   // where the predicted step takes the two points
  std::array<Eigen::Vector2d, 2> target;  // where the tiny images saw them go [px]
  for (size_t i = 0; i < 2; ++i) {
    const Eigen::Vector2f offset(i == 0 ? -options.offset : options.offset, 0.0F);
    const auto full_pixel = [](const Eigen::Vector2f& tiny) {
      return Eigen::Vector2d(from_level(tiny.x(), kTinyLevel), from_level(tiny.y(), kTinyLevel));
    };
    moved[i] = predicted_step * (mean_depth * camera.unproject(full_pixel(center + offset)));
    target[i] = full_pixel(center + turn * offset + seen.shift);
  }

  Eigen::Quaterniond correction = Eigen::Quaterniond::Identity();
  for (int iteration = 0; iteration < options.iterations; ++iteration) {
    LeastSquares<3> equations;
    equations.information.diagonal().setConstant(options.prior);
    for (size_t i = 0; i < 2; ++i) {
      const Eigen::Vector3d point = correction * moved[i];
      Matrix23d jacobian;
      const auto pixel = camera.project(point, &jacobian);
      if (!pixel) return predicted_step;
      const Matrix23d by_rotation = -jacobian * skew(point);
      equations.add(by_rotation, Eigen::Vector2d(*pixel - target[i]));
    }
    const auto step = equations.step();
    if (!step) return predicted_step;
    correction = so3_exp(*step) * correction;
  }
  return SE3(correction, Eigen::Vector3d::Zero()) * predicted_step;
}

SE3 correct_translation(const SE3& step, const TinyMotion& seen, const Camera& camera, double mean_depth) {
  if (!std::isfinite(seen.score)) return step;
  constexpr int kTinyLevel = kPyramidLevels;
  const Eigen::Vector2f center((static_cast<float>(camera.width() >> kTinyLevel) - 1.0F) / 2.0F,
                               (static_cast<float>(camera.height() >> kTinyLevel) - 1.0F) / 2.0F);
  const auto full_pixel = [](const Eigen::Vector2f& tiny) {
    return Eigen::Vector2d(from_level(tiny.x(), kTinyLevel), from_level(tiny.y(), kTinyLevel));
  };
  const Eigen::Vector3d moved = step * (mean_depth * camera.unproject(full_pixel(center)));
  Matrix23d jacobian;
  const auto pixel = camera.project(moved, &jacobian);
  if (!pixel) return step;
  const Eigen::Vector2d off = full_pixel(center + seen.shift) - *pixel;
  const Eigen::Vector2d across = jacobian.leftCols<2>().inverse() * off;
  return SE3(Eigen::Quaterniond::Identity(), Eigen::Vector3d(across.x(), across.y(), 0)) * step;
}

}  // namespace cairn
