// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <random>
#include <string>
#include <vector>

#include "common/base/result.h"
#include "common/image/tiny_image.h"

/// Tiny images that never were, with the statistics of recorded ones.
namespace cairn {

/// What tiny images are like: normally distributed about a mean, places by one covariance, and the images
/// taken at a place about it by another.
class ImageStatistics {
 public:
  /// Measures statistics of every `every`-th frame of some recordings with images of 640x480; others are
  /// passed over. Frames `apart` apart (in frames) are taken for two images of one place.
  [[nodiscard]] static Result<ImageStatistics> measure(const std::vector<std::string>& sources, size_t every,
                                                       size_t apart);

  [[nodiscard]] size_t frames() const { return frames_; }
  /// Components that hold 0.999 of the variance of all images.
  [[nodiscard]] size_t dimensions() const;
  /// Share of the variance that images of one place have about it.
  [[nodiscard]] double share_within() const;

  /// Grey levels of the tiny image that all images of a place vary about.
  [[nodiscard]] Eigen::VectorXf draw_place(std::mt19937_64* random) const;
  /// Clipped to what a camera can give, in steps of a quarter.
  [[nodiscard]] TinyImage draw_image(const Eigen::VectorXf& place, std::mt19937_64* random) const;

 private:
  Eigen::VectorXf mean_;
  Eigen::VectorXf all_variances_;  ///< of the principal components of all images
  Eigen::MatrixXf between_;        ///< columns: principal components of places, by their standard deviations
  Eigen::MatrixXf within_;         ///< likewise, of the images of a place about it
  size_t frames_ = 0;
};

}  // namespace cairn
