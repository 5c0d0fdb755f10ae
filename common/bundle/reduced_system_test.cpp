// SPDX-License-Identifier: Apache-2.0
#include "common/bundle/reduced_system.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cstring>
#include <numeric>

#include "common/bundle/bundle_scene.h"

namespace cairn {
namespace {

using testing::Random;

/// Points seen by `length` poses in a row, and what they leave of the identity times 100 on the diagonal.
struct Case {
  Case(int poses, int length, Random* random) : poses(poses) {
    for (int first = 0; first + length <= poses; ++first) {
      tracks.emplace_back(static_cast<size_t>(length));
      std::iota(tracks.back().begin(), tracks.back().end(), first);
      for (int i = 0; i < length * kSlotElements; ++i) slots.push_back(random->normal(1));
    }
  }

  void fill(ReducedSystem* system) const {
    system->set_zero();
    for (int i = 0; i < poses; ++i) {
      system->add_diagonal(i, 100.0 * Eigen::Matrix<double, kPoseSize, kPoseSize>::Identity());
    }
    const double* z = slots.data();
    for (const std::vector<int>& track : tracks) {
      system->kernels().subtract_point(z, track.data(), static_cast<int>(track.size()), system->table());
      z += track.size() * kSlotElements;
    }
  }

  [[nodiscard]] Eigen::MatrixXd dense() const {
    const int n = poses * kPoseSize;
    Eigen::MatrixXd matrix = 100.0 * Eigen::MatrixXd::Identity(n, n);
    const double* z = slots.data();
    for (const std::vector<int>& track : tracks) {
      Eigen::MatrixXd Z = Eigen::MatrixXd::Zero(n, kPointSize);
      for (const int pose : track) {
        Z.middleRows<kPoseSize>(pose * kPoseSize) =
            Eigen::Map<const Eigen::Matrix<double, kPoseSize, kPointSize>>(z);
        z += kSlotElements;
      }
      matrix -= Z * Z.transpose();
    }
    return matrix;
  }

  int poses;
  std::vector<std::vector<int>> tracks;
  std::vector<double> slots;
};

TEST(ReducedSystem, SolvesAsADenseFactorizationDoes) {
  for (uint64_t seed = 1; seed <= 20; ++seed) {
    SCOPED_TRACE(seed);
    Random random(seed);
    const int poses = static_cast<int>(random.uniform(1, 60));
    const Case c(poses, std::min(poses, 4), &random);
    ReducedSystem system(poses, c.tracks, best_tile_kernels());
    c.fill(&system);
    Eigen::VectorXd b(poses * kPoseSize);
    for (double& value : b) value = random.normal(1);
    const Eigen::VectorXd expected = c.dense().llt().solve(b);
    ASSERT_EQ(system.factorize({}), ReducedSystem::Outcome::kDone);
    system.solve(&b);
    EXPECT_LT((b - expected).norm(), 1e-10 * expected.norm());
  }
}

TEST(ReducedSystem, InstructionSetsAgreeToTheLastBit) {
  Random random(1);
  const Case c(45, 5, &random);
  std::vector<Eigen::VectorXd> solutions;
  for (const TileKernels* kernels : {&baseline_tile_kernels(), &best_tile_kernels()}) {
    ReducedSystem system(c.poses, c.tracks, *kernels);
    c.fill(&system);
    ASSERT_EQ(system.factorize({}), ReducedSystem::Outcome::kDone);
    solutions.emplace_back(Eigen::VectorXd::LinSpaced(c.poses * kPoseSize, -1, 1));
    system.solve(&solutions.back());
  }
  EXPECT_EQ(0, std::memcmp(solutions[0].data(), solutions[1].data(),
                           static_cast<size_t>(solutions[0].size()) * sizeof(double)));
}

TEST(ReducedSystem, ALongMapTakesMemoryInProportion) {
  Random random(2);
  const Case c(400, 5, &random);
  const Case d(800, 5, &random);
  const ReducedSystem half(c.poses, c.tracks, best_tile_kernels());
  const ReducedSystem whole(d.poses, d.tracks, best_tile_kernels());
  EXPECT_LT(whole.bytes(), 2.1 * static_cast<double>(half.bytes()));
}

TEST(ReducedSystem, SaysThatItIsSingular) {
  const std::vector<std::vector<int>> tracks{{0, 1, 2}};
  ReducedSystem system(12, tracks, best_tile_kernels());
  system.set_zero();
  for (int i = 0; i < 12; ++i) {
    if (i != 7) system.add_diagonal(i, Eigen::Matrix<double, kPoseSize, kPoseSize>::Identity());
  }
  EXPECT_EQ(system.factorize({}), ReducedSystem::Outcome::kSingular);
}

TEST(ReducedSystem, StopsWhenTold) {
  Random random(3);
  const Case c(100, 30, &random);
  ReducedSystem system(c.poses, c.tracks, best_tile_kernels());
  system.set_zero();
  for (int i = 0; i < c.poses; ++i) {
    system.add_diagonal(i, Eigen::Matrix<double, kPoseSize, kPoseSize>::Identity());
  }
  int polls = 0;
  EXPECT_EQ(system.factorize([&polls] { return ++polls == 3; }), ReducedSystem::Outcome::kStopped);
  EXPECT_EQ(polls, 3);
}

}  // namespace
}  // namespace cairn
