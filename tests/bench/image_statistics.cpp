// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/image_statistics.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "client/capture/frame_source.h"
#include "common/image/pyramid.h"
#include "server/relocalization/place_index.h"

namespace cairn {
namespace {

constexpr int kWidth = 40;  ///< of a tiny image
constexpr int kHeight = 30;
constexpr float kMiddleGrey = 128;
constexpr float kLeastVariance = 1e-6F;  ///< of the largest: what is less is rounding

using Rows = std::vector<Eigen::VectorXf>;

Result<Rows> read_images(const std::string& uri, size_t every) {
  auto source = open_source(uri);
  if (!source) return tl::unexpected(source.error());
  Rows rows;
  Pyramid pyramid;
  for (;;) {
    const auto next = (*source)->next();
    if (!next) continue;
    if (!*next) break;
    const Frame& frame = **next;
    if (frame.index % every != 0) continue;
    pyramid.build(frame.image->view());
    const TinyImage tiny(pyramid.level(kPyramidLevels - 1), kPlaceBlur);
    if (tiny.width() != kWidth || tiny.height() != kHeight) continue;
    rows.emplace_back(Eigen::Map<const Eigen::VectorXf>(tiny.values().data(),
                                                        static_cast<Eigen::Index>(tiny.values().size())));
  }
  return rows;
}

Eigen::MatrixXf covariance_of(const Rows& rows) {
  Eigen::MatrixXf data(kWidth * kHeight, static_cast<Eigen::Index>(rows.size()));
  for (size_t i = 0; i < rows.size(); ++i) data.col(static_cast<Eigen::Index>(i)) = rows[i];
  return data * data.transpose() / static_cast<float>(rows.size());
}

/// A matrix that makes of independent normal numbers vectors with this covariance.
Eigen::MatrixXf root_of(const Eigen::MatrixXf& covariance) {
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXf> solved(covariance);
  const Eigen::VectorXf& variances = solved.eigenvalues();  // ascending
  const float least = kLeastVariance * variances(variances.size() - 1);
  const auto kept = (variances.array() > least).count();
  return solved.eigenvectors().rightCols(kept) * variances.tail(kept).cwiseSqrt().asDiagonal();
}

Eigen::VectorXf draw(const Eigen::MatrixXf& root, std::mt19937_64* random) {
  std::normal_distribution<float> normal;
  return root * Eigen::VectorXf::NullaryExpr(root.cols(), [&] { return normal(*random); });
}

}  // namespace

Result<ImageStatistics> ImageStatistics::measure(const std::vector<std::string>& sources, size_t every,
                                                 size_t apart) {
  Rows images;
  Rows differences;
  const size_t step = std::max<size_t>(1, apart / every);
  for (const std::string& uri : sources) {
    const auto rows = read_images(uri, every);
    if (!rows) return tl::unexpected(rows.error());
    images.insert(images.end(), rows->begin(), rows->end());
    // Of two independent images of a place: the difference has twice the variance.
    for (size_t i = step; i < rows->size(); ++i)
      differences.emplace_back(((*rows)[i] - (*rows)[i - step]) / std::sqrt(2.0F));
  }
  if (differences.empty()) return fail(ErrorCode::kUsage, "no recording has two images of 640x480");
  ImageStatistics statistics;
  statistics.frames_ = images.size();
  statistics.mean_ = Eigen::VectorXf::Zero(kWidth * kHeight);
  for (const Eigen::VectorXf& p : images) statistics.mean_ += p / static_cast<float>(images.size());
  for (Eigen::VectorXf& p : images) p -= statistics.mean_;
  const Eigen::MatrixXf all = covariance_of(images);
  const Eigen::MatrixXf within = covariance_of(differences);
  statistics.all_variances_ =
      Eigen::SelfAdjointEigenSolver<Eigen::MatrixXf>(all, Eigen::EigenvaluesOnly).eigenvalues();
  statistics.within_ = root_of(within);
  statistics.between_ = root_of(all - within);
  return statistics;
}

size_t ImageStatistics::dimensions() const {
  const float enough = 0.999F * all_variances_.sum();
  float sum = 0;
  size_t count = 0;
  while (sum < enough) sum += all_variances_(all_variances_.size() - static_cast<Eigen::Index>(++count));
  return count;
}

double ImageStatistics::share_within() const {
  return static_cast<double>(within_.squaredNorm() / all_variances_.sum());
}

Eigen::VectorXf ImageStatistics::draw_place(std::mt19937_64* random) const {
  return mean_ + draw(between_, random);
}

TinyImage ImageStatistics::draw_image(const Eigen::VectorXf& place, std::mt19937_64* random) const {
  const Eigen::VectorXf values = place + draw(within_, random);
  // Each value becomes four pixels whose mean comes nearest.
  GrayImage level3(2 * kWidth, 2 * kHeight);
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      const float grey = std::clamp(values(y * kWidth + x) + kMiddleGrey, 0.0F, 254.0F);
      const auto quarters = static_cast<int>(std::lround(4 * grey));
      for (int i = 0; i < 4; ++i)
        level3.row(2 * y + i / 2)[2 * x + i % 2] = static_cast<uint8_t>((quarters + i) / 4);
    }
  }
  return {level3, 0};
}

}  // namespace cairn
