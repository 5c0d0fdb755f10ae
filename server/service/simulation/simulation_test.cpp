// SPDX-License-Identifier: Apache-2.0
#include "server/service/simulation/simulation.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <string>

namespace cairn::simulation {
namespace {

#ifdef __SANITIZE_ADDRESS__
constexpr uint64_t kSeeds = 60;  // each takes several times as long
#else
constexpr uint64_t kSeeds = 300;
#endif
constexpr uint64_t kCases = 10;  ///< that run beside each other

/// Of one seed, with what it takes to see it again.
void expect_well(uint64_t seed, const Logger& log) {
  const Report report = run(seed, log);
  for (const std::string& violation : report.violations) {
    ADD_FAILURE() << "seed " << seed << ": " << violation << "\n  again: CAIRN_SIMULATION_SEED=" << seed
                  << " build/release/bin/simulation_test --gtest_filter=*OneSeed";
  }
}

class SimulatedServer : public ::testing::TestWithParam<uint64_t> {};

TEST_P(SimulatedServer, KeepsItsWord) {
  for (uint64_t seed = 1 + GetParam(); seed <= kSeeds; seed += kCases) expect_well(seed, null_logger());
}
INSTANTIATE_TEST_SUITE_P(Seeds, SimulatedServer, ::testing::Range(uint64_t{0}, kCases));

/// One, with all that the server logs; or as many as CAIRN_SIMULATION_SEEDS says, from that one on.
TEST(SimulatedServerTest, OneSeed) {
  const char* first = std::getenv("CAIRN_SIMULATION_SEED");
  const char* count = std::getenv("CAIRN_SIMULATION_SEEDS");
  const uint64_t seed = first == nullptr ? 1 : std::stoull(first);
  if (count != nullptr) {
    for (uint64_t i = 0; i < std::stoull(count); ++i) expect_well(seed + i, null_logger());
    return;
  }
  expect_well(seed, first == nullptr ? null_logger() : make_logger("simulation", 1));
}

}  // namespace
}  // namespace cairn::simulation
