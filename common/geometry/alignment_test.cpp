// SPDX-License-Identifier: Apache-2.0
#include "common/geometry/alignment.h"

#include <gtest/gtest.h>

#include <random>

namespace cairn {
namespace {

std::vector<Eigen::Vector3d> cloud(unsigned seed, size_t n, const Eigen::Vector3d& extent) {
  std::mt19937 engine(seed);
  std::normal_distribution<double> normal;
  std::vector<Eigen::Vector3d> points(n);
  for (auto& p : points)
    p = extent.cwiseProduct(Eigen::Vector3d{normal(engine), normal(engine), normal(engine)});
  return points;
}

std::vector<Eigen::Vector3d> mapped(const Similarity3& b_from_a, const std::vector<Eigen::Vector3d>& points) {
  std::vector<Eigen::Vector3d> result;
  result.reserve(points.size());
  for (const auto& p : points) result.push_back(b_from_a * p);
  return result;
}

double squared_error(const Similarity3& b_from_a, const std::vector<Eigen::Vector3d>& from,
                     const std::vector<Eigen::Vector3d>& to) {
  double sum = 0;
  for (size_t i = 0; i < from.size(); ++i) sum += (b_from_a * from[i] - to[i]).squaredNorm();
  return sum;
}

Similarity3 some_similarity(unsigned seed, double scale) {
  const auto v = cloud(seed, 2, {1, 1, 1});
  return {scale, so3_exp(v[0]), 3 * v[1]};
}

TEST(AlignPoints, RecoversASimilarityAlsoFromCoplanarPointsAndFromThree) {
  for (unsigned seed = 1; seed < 50; ++seed) {
    const Similarity3 truth = some_similarity(seed, 0.2 + 0.1 * seed);
    for (const auto& from : {cloud(seed, 40, {1, 1, 1}), cloud(seed, 40, {1, 1, 0}),
                             cloud(seed, 3, {1, 1, 1}), cloud(seed, 9, {1e-3, 1e-3, 0})}) {
      const auto found = align_points(from, mapped(truth, from), true);
      ASSERT_TRUE(found) << "seed " << seed;
      EXPECT_NEAR(found->scale() / truth.scale(), 1, 1e-9) << "seed " << seed;
      EXPECT_LT(found->rotation().angularDistance(truth.rotation()), 1e-7) << "seed " << seed;
      EXPECT_LT((found->translation() - truth.translation()).norm(), 1e-8) << "seed " << seed;
    }
  }
}

TEST(AlignPoints, WithoutScaleHasScaleOneAndIsRigid) {
  const auto from = cloud(3, 30, {1, 2, 1});
  const auto found = align_points(from, mapped(some_similarity(4, 1.7), from), false);
  ASSERT_TRUE(found);
  EXPECT_EQ(found->scale(), 1.0);
  EXPECT_LT(found->rotation().angularDistance(some_similarity(4, 1.7).rotation()), 1e-7);
}

TEST(AlignPoints, IsALeastSquaresMinimumUnderNoise) {
  for (unsigned seed = 1; seed < 20; ++seed) {
    const auto from = cloud(seed, 25, {1, 1, 1});
    auto to = mapped(some_similarity(seed, 1.3), from);
    const auto noise = cloud(seed + 100, 25, {0.1, 0.1, 0.1});
    for (size_t i = 0; i < to.size(); ++i) to[i] += noise[i];
    const auto found = align_points(from, to, true);
    ASSERT_TRUE(found);
    for (int k = 0; k < 7; ++k) {
      for (const double step : {-1e-4, 1e-4}) {
        const Similarity3 near = Similarity3::exp(step * Vector7d::Unit(k)) * *found;
        EXPECT_GT(squared_error(near, from, to), squared_error(*found, from, to))
            << "seed " << seed << " direction " << k;
      }
    }
  }
}

TEST(AlignPoints, NeverReflects) {
  const auto from = cloud(7, 20, {1, 1, 1});
  auto to = from;
  for (auto& p : to) p.x() = -p.x();
  const auto found = align_points(from, to, true);
  ASSERT_TRUE(found);
  EXPECT_GT(found->rotation().toRotationMatrix().determinant(), 0.99);
}

TEST(AlignPoints, RefusesWhatDoesNotDetermineIt) {
  const Eigen::Vector3d p(1, 2, 3);
  const Eigen::Vector3d q(0.3, -0.2, 0.1);
  const std::vector<Eigen::Vector3d> two{p, q};
  const std::vector<Eigen::Vector3d> line{p, p + q, p + 3 * q, p - 7 * q};
  const std::vector<Eigen::Vector3d> place(10, p);
  for (const auto& points : {two, line, place, std::vector<Eigen::Vector3d>{}}) {
    const auto found = align_points(points, points, true);
    ASSERT_FALSE(found);
    EXPECT_EQ(found.error().code, ErrorCode::kDegenerate);
  }
  const auto good = cloud(1, 4, {1, 1, 1});
  EXPECT_FALSE(align_points(good, line, true));
  EXPECT_FALSE(align_points(good, cloud(1, 5, {1, 1, 1}), true));
}

}  // namespace
}  // namespace cairn
