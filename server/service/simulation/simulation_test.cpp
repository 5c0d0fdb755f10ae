// SPDX-License-Identifier: Apache-2.0
#include "server/service/simulation/simulation.h"

#include <gtest/gtest.h>

#include <cstdio>
#include <cstdlib>
#include <map>
#include <string>
#include <utility>

namespace cairn::simulation {
namespace {

#ifdef __SANITIZE_ADDRESS__
constexpr uint64_t kSeeds = 60;  // each takes several times as long
#else
constexpr uint64_t kSeeds = 300;
#endif
constexpr uint64_t kCases = 10;   ///< that run beside each other
constexpr uint64_t kEnough = 30;  ///< seeds of a case, for each kind of thing to take place in some

/// Of one seed, with what it takes to see it again.
Report expect_well(uint64_t seed, const Logger& log) {
  Report report = run(seed, log);
  for (const std::string& violation : report.violations) {
    ADD_FAILURE() << "seed " << seed << ": " << violation << "\n  again: CAIRN_SIMULATION_SEED=" << seed
                  << " build/release/bin/simulation_test --gtest_filter=*OneSeed";
  }
  return report;
}

/// What took place in many runs: one in which nothing does finds nothing.
struct Sums {
  std::map<std::string, size_t> of;
  void add(const Report& report) {
    const Curator::Done& curated = report.curated;
    for (const auto& [what, count] : {std::pair("starts", report.starts),
                                      {"kills", report.kills},
                                      {"maps", report.maps},
                                      {"revisions", report.revisions},
                                      {"tags", curated.tags},
                                      {"roll-backs", curated.roll_backs},
                                      {"copies", curated.copies},
                                      {"proposals accepted", curated.accepted},
                                      {"proposals decided", curated.accepted + curated.dropped},
                                      {"backups restored", curated.restored}})
      of[what] += count;
  }
};

class SimulatedServer : public ::testing::TestWithParam<uint64_t> {};

TEST_P(SimulatedServer, KeepsItsWord) {
  Sums sums;
  uint64_t seeds = 0;
  for (uint64_t seed = 1 + GetParam(); seed <= kSeeds; seed += kCases, ++seeds)
    sums.add(expect_well(seed, null_logger()));
  if (seeds < kEnough) return;
  for (const auto& [what, count] : sums.of) EXPECT_GE(count, 1U) << what;
}
INSTANTIATE_TEST_SUITE_P(Seeds, SimulatedServer, ::testing::Range(uint64_t{0}, kCases));

/// One, with all that the server logs; or as many as CAIRN_SIMULATION_SEEDS says, from that one on.
TEST(SimulatedServerTest, OneSeed) {
  const char* first = std::getenv("CAIRN_SIMULATION_SEED");
  const char* count = std::getenv("CAIRN_SIMULATION_SEEDS");
  const uint64_t seed = first == nullptr ? 1 : std::stoull(first);
  if (count != nullptr) {
    Sums sums;
    for (uint64_t i = 0; i < std::stoull(count); ++i) sums.add(expect_well(seed + i, null_logger()));
    for (const auto& [what, times] : sums.of) std::printf("%s: %zu\n", what.c_str(), times);
    return;
  }
  (void)expect_well(seed, first == nullptr ? null_logger() : make_logger("simulation", 1));
}

}  // namespace
}  // namespace cairn::simulation
