// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <random>
#include <string>

// For tests only.
namespace cairn::testing {

/// A seed for a test that tries something else each time: CAIRN_TEST_SEED where that is set, as in CI, else a
/// random one. It is printed, so that what a run shows can be repeated.
inline uint32_t any_seed() {
  const char* given = std::getenv("CAIRN_TEST_SEED");
  const uint32_t seed =
      given != nullptr ? static_cast<uint32_t>(std::strtoul(given, nullptr, 10)) : std::random_device()();
  std::printf("seed %u; CAIRN_TEST_SEED=%u repeats it\n", seed, seed);
  std::fflush(stdout);
  return seed;
}

}  // namespace cairn::testing
